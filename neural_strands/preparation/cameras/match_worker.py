"""Detects and matches features with COLMAP in a process of its own, because COLMAP aborts its process on a full disk.

The request on standard input names `database`, `images`, `masks` (or null), `partners` (with how many others a
photograph is matched, or null for all) and `groups`: for each lens its photographs (`names`), camera model (`model`),
parameters (`params`, may be empty), the `focal` length to start from, in multiples of the longer side, and the number
of `threads`. One line is printed after each group, and one at the end.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from neural_strands.preparation.cameras.likely_pairs import largest_features, likely_pairs

PAIRS = "pairs.txt"


def main(request: dict[str, Any]) -> None:
    """Fill the database."""
    # What COLMAP reports as an error, such as that nothing matches, is told by its caller.
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    pycolmap.Database.open(request["database"]).close()
    for group in request["groups"]:
        options = pycolmap.ImageReaderOptions()
        options.camera_model = group["model"]
        options.camera_params = group["params"]
        options.default_focal_length_factor = group["focal"]
        if request["masks"] is not None:
            options.mask_path = request["masks"]
        # First, in the order of their names: detectors number images in the order in which they finish.
        pycolmap.import_images(
            request["database"],
            request["images"],
            camera_mode=pycolmap.CameraMode.SINGLE,
            image_names=group["names"],
            options=options,
        )
        extraction = pycolmap.FeatureExtractionOptions()
        extraction.num_threads = group["threads"]
        pycolmap.extract_features(
            request["database"],
            request["images"],
            image_names=group["names"],
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=options,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        tell("detected")
    verification = pycolmap.TwoViewGeometryOptions()
    # Without it, the random numbers of a pair depend on the pairs that its thread has verified before.
    verification.ransac.random_seed = 0
    how: dict[str, Any] = {"verification_options": verification, "device": pycolmap.Device.cpu}
    if request["partners"] is None:
        pycolmap.match_exhaustive(request["database"], **how)
    else:
        match_likely_pairs(request["database"], request["partners"], how)
    tell("matched")


def match_likely_pairs(path: str, partners: int, how: dict[str, Any]) -> None:
    """Match the photographs in a database that look as if they overlap."""
    with pycolmap.Database.open(path) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.image_id)
        largest = [
            largest_features(
                database.read_descriptors(image.image_id).data, feature_scales(database.read_keypoints(image.image_id))
            )
            for image in images
        ]
        # COLMAP's list of pairs is split at spaces, which names may contain.
        rename(database, {image.image_id: str(image.image_id) for image in images})
    pairs = Path(path).with_name(PAIRS)
    pairs.write_text(
        "".join(
            f"{images[first].image_id} {images[second].image_id}\n" for first, second in likely_pairs(largest, partners)
        )
    )
    pairing = pycolmap.ImportedPairingOptions(match_list_path=pairs)
    pycolmap.match_image_pairs(path, pairing_options=pairing, **how)
    pairs.unlink()
    with pycolmap.Database.open(path) as database:
        rename(database, {image.image_id: image.name for image in images})


def rename(database: pycolmap.Database, names: dict[int, str]) -> None:
    """Give photographs other names."""
    for image in database.read_all_images():
        image.name = names[image.image_id]
        database.update_image(image)


def feature_scales(keypoints: np.ndarray) -> np.ndarray:
    """The size of each feature: COLMAP stores x, y and the four numbers of an affine shape."""
    xx, xy, yx, yy = keypoints[:, 2:6].T
    return np.sqrt(np.abs(xx * yy - xy * yx))


def tell(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(json.load(sys.stdin))
