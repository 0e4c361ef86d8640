"""Detects and matches features with COLMAP in a process of its own, because COLMAP aborts its process on a full disk.

It needs only pycolmap. The request on standard input names `database`, `images`, `masks` (or null) and `groups`: for
each lens its photographs (`names`), camera model (`model`), parameters (`params`, may be empty), the `focal` length to
start from, in multiples of the longer side, and the number of `threads`. One line is printed after each group, and one
at the end.
"""

import json
import sys
from typing import Any

import pycolmap


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
    pycolmap.match_exhaustive(request["database"], verification_options=verification, device=pycolmap.Device.cpu)
    tell("matched")


def tell(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(json.load(sys.stdin))
