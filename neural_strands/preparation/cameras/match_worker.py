"""Detects and matches features with COLMAP in a process of its own, because COLMAP aborts its process on a full disk.

The request on standard input names `database`, `images`, `masks` (or null), `partners` (with how many others a
photograph is matched, or null for all), `blocks` (in how many parts pairs are matched) and `groups`: for each lens its
photographs (`names`), camera model (`model`), parameters (`params`, may be empty), the `focal` length to start from, in
multiples of the longer side, and the number of `threads`. A line is printed for each photograph after its features are
found, and for each block after its pairs are matched; the last one is `FINISHED`.
"""

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from neural_strands.preparation.cameras.likely_pairs import largest_features, likely_pairs

PAIRS = "pairs.txt"
AT_ONCE = 4
"""Photographs for each thread between two reports."""
FINISHED = "finished"


def main(request: dict[str, Any]) -> None:
    """Fill the database."""
    # What COLMAP reports as an error, such as that nothing matches, is told by its caller.
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    pycolmap.Database.open(request["database"]).close()
    for group in request["groups"]:
        detect(group, request["database"], request["images"], request["masks"])
    match(request["database"], request["partners"], request["blocks"])
    tell(FINISHED)


def detect(group: dict[str, Any], database: str, images: str, masks: str | None) -> None:
    """Find the features of photographs that share a lens."""
    options = pycolmap.ImageReaderOptions()
    options.camera_model = group["model"]
    options.camera_params = group["params"]
    options.default_focal_length_factor = group["focal"]
    if masks is not None:
        options.mask_path = masks
    names = group["names"]
    # First, in the order of their names: detectors number images in the order in which they finish.
    pycolmap.import_images(database, images, camera_mode=pycolmap.CameraMode.SINGLE, image_names=names, options=options)
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads = group["threads"]
    several = AT_ONCE * group["threads"]
    for first in range(0, len(names), several):
        part = names[first : first + several]
        pycolmap.extract_features(
            database,
            images,
            image_names=part,
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=options,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        for name in part:
            tell(name)


def match(path: str, partners: int | None, blocks: int) -> None:
    """Match the photographs in a database: all pairs, or those that look as if they overlap."""
    with pycolmap.Database.open(path) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.image_id)
        if partners is None:
            chosen = list(itertools.combinations(range(len(images)), 2))
        else:
            chosen = likely_pairs([largest(database, image.image_id) for image in images], partners).tolist()
        # COLMAP's list of pairs is split at spaces, which names may contain.
        rename(database, {image.image_id: str(image.image_id) for image in images})
    verification = pycolmap.TwoViewGeometryOptions()
    # Without it, the random numbers of a pair depend on the pairs that its thread has verified before.
    verification.ransac.random_seed = 0
    pairs = Path(path).with_name(PAIRS)
    pairing = pycolmap.ImportedPairingOptions(match_list_path=pairs)
    for block in range(blocks):
        part = chosen[block * len(chosen) // blocks : (block + 1) * len(chosen) // blocks]
        if part:
            pairs.write_text("".join(f"{images[i].image_id} {images[j].image_id}\n" for i, j in part))
            pycolmap.match_image_pairs(
                path, pairing_options=pairing, verification_options=verification, device=pycolmap.Device.cpu
            )
        tell(PAIRS)
    pairs.unlink(missing_ok=True)
    with pycolmap.Database.open(path) as database:
        rename(database, {image.image_id: image.name for image in images})


def largest(database: pycolmap.Database, image: int) -> np.ndarray:
    """Descriptors of the largest features of a photograph; COLMAP stores x, y and four numbers of an affine shape."""
    xx, xy, yx, yy = database.read_keypoints(image)[:, 2:6].T
    return largest_features(database.read_descriptors(image).data, np.sqrt(np.abs(xx * yy - xy * yx)))


def rename(database: pycolmap.Database, names: dict[int, str]) -> None:
    """Give photographs other names."""
    for image in database.read_all_images():
        image.name = names[image.image_id]
        database.update_image(image)


def tell(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(json.load(sys.stdin))
