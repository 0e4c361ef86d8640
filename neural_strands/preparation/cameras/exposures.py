"""How each photograph was exposed and its white balance, from the colours of points that several photographs show.

While only the camera moves, lights and surfaces stay as they are, so a point has the same colour in all photographs
except for the exposure. Highlights move with the camera; the sum of absolute differences is minimised, so that they
hardly count.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.sparse import csr_array

from neural_strands.foundation.files import write_json
from neural_strands.foundation.json_files import JsonValue, read_json
from neural_strands.foundation.srgb import linear_samples, srgb_samples
from neural_strands.preparation.photographs.folder import read_picture
from neural_strands.preparation.stage import ADVICE

if TYPE_CHECKING:
    import pycolmap

EXPOSURES = "exposures.json"
WINDOW = 5
"""Side of the square over which a point's colour is averaged, pixels."""
BURNT, DARKEST = 250, 0.003
"""Sample (of 255) from which a square counts as burnt out, and linear light below which it is too dark."""
FULL = np.iinfo(np.uint16).max
"""Sample of the brightest linear light."""
ROUNDS = 20
LEAST_DIFFERENCE = 0.02
"""Differences below this are weighted as if they were as large, stops; it is less than the noise of a photograph."""
FEWEST_POINTS = 30
"""Number of points from which a photograph's exposure is estimated; with fewer, it is taken to be the median."""
NOTICEABLE = 0.1
"""Largest difference between photographs, in stops, at which they are still left as they are."""
MOST_STOPS = 20.0
"""Largest plausible difference, in stops."""


@dataclass(frozen=True)
class SeenColours:
    """Colours of points in photographs, one row per point and photograph that shows it.

    Attributes:
        photograph: number of the photograph.
        point: number of the point.
        stops: linear light of red, green and blue, as logarithms to base 2.
    """

    photograph: Int[np.ndarray, " sighting"]
    point: Int[np.ndarray, " sighting"]
    stops: Float[np.ndarray, "sighting 3"]


def seen_colours(images: Path, model: "pycolmap.Reconstruction") -> tuple[list[str], SeenColours]:
    """Read the colours of a model's points in the photographs that show them.

    Args:
        images: folder of the photographs.
        model: points and the pixels at which photographs show them.

    Returns:
        The names of the photographs with a camera, and the colours.

    Raises:
        InputError: a photograph cannot be read.
    """
    posed = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    rows = []
    for number, image in enumerate(posed):
        marks = [mark for mark in image.points2D if mark.has_point3D()]
        pixel = np.array([mark.xy for mark in marks], dtype=np.float64).reshape(-1, 2).astype(np.int64)
        point = np.array([mark.point3D_id for mark in marks], dtype=np.int64)
        stops, usable = _colours_at(read_picture(images / image.name), pixel)
        rows.append((np.full(int(usable.sum()), number), point[usable], stops[usable]))
    photograph, point, stops = (np.concatenate(part) for part in zip(*rows, strict=True))
    return [image.name for image in posed], SeenColours(photograph, np.unique(point, return_inverse=True)[1], stops)


def _colours_at(
    picture: UInt8[np.ndarray, "height width 3"], pixel: Int[np.ndarray, "mark 2"]
) -> tuple[Float[np.ndarray, "mark 3"], np.ndarray]:
    """Colours around pixels in stops, and whether they are neither burnt out nor too dark."""
    light = cv2.blur(linear_samples(picture).astype(np.float32) / np.float32(FULL), (WINDOW, WINDOW))
    brightest = cv2.dilate(picture.max(axis=-1), np.ones((WINDOW, WINDOW), np.uint8))
    height, width = picture.shape[:2]
    column, row = pixel[:, 0].clip(0, width - 1), pixel[:, 1].clip(0, height - 1)
    seen = light[row, column].astype(np.float64)
    usable = (brightest[row, column] < BURNT) & (seen.min(axis=-1, initial=1.0) > DARKEST)
    return np.log2(np.maximum(seen, DARKEST)), usable


def estimate_exposures(seen: SeenColours, photographs: int) -> Float[np.ndarray, "photograph 3"]:
    """Estimate exposures from colours: those that minimise the sum of absolute differences.

    A colour is the point's own plus the photograph's exposure. Iteratively reweighted least squares; the points are
    eliminated, so that one small dense system is left per channel.

    Args:
        seen: the colours.
        photographs: their number.

    Returns:
        Exposure of red, green and blue in stops, relative to the median of the photographs.
    """
    channels = [_channel(seen, seen.stops[:, channel], photographs) for channel in range(3)]
    exposure = np.stack(channels, axis=1)
    known = np.bincount(seen.photograph, minlength=photographs) >= FEWEST_POINTS
    if not known.any():
        return np.zeros((photographs, 3))
    return np.where(known[:, None], exposure - np.median(exposure[known], axis=0), 0.0)


def _channel(
    seen: SeenColours, stops: Float[np.ndarray, " sighting"], photographs: int
) -> Float[np.ndarray, " photograph"]:
    """Exposures of one channel, up to a constant."""
    size = (photographs, int(seen.point.max(initial=-1)) + 1)
    exposure, weight = np.zeros(photographs), np.ones(len(stops))
    for _ in range(ROUNDS):
        share = csr_array((weight, (seen.photograph, seen.point)), shape=size)
        total = np.maximum(share.sum(axis=0), 1e-12)
        mean = np.bincount(seen.point, weight * stops, size[1]) / total
        scaled = csr_array(share.multiply(1.0 / total))
        system = np.diag(share.sum(axis=1)) - (share @ scaled.T).toarray()
        side = np.bincount(seen.photograph, weight * (stops - mean[seen.point]), photographs)
        exposure = np.linalg.lstsq(system, side, rcond=1e-9)[0]
        colour = np.bincount(seen.point, weight * (stops - exposure[seen.photograph]), size[1]) / total
        weight = 1.0 / np.maximum(np.abs(stops - exposure[seen.photograph] - colour[seen.point]), LEAST_DIFFERENCE)
    return exposure


def write_exposures(folder: Path, names: Sequence[str], exposures: Float[np.ndarray, "photograph 3"]) -> None:
    """Write the exposure of each photograph, in stops."""
    write_json(folder / EXPOSURES, dict(zip(names, np.round(exposures, 4).tolist(), strict=True)))


def read_exposures(folder: Path) -> dict[str, Float[np.ndarray, "3"]]:
    """Read what `write_exposures` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    written = read_json(folder / EXPOSURES, "exposures", ADVICE).members()
    return {name: _three_stops(stops) for name, stops in written.items()}


def _three_stops(written: JsonValue) -> Float[np.ndarray, "3"]:
    stops = [stop.number(-MOST_STOPS, MOST_STOPS) for stop in written.elements()]
    if len(stops) != 3:
        raise written.refuse("three numbers")
    return np.array(stops)


def noticeable_exposures(folder: Path) -> dict[str, Float[np.ndarray, "3"]] | None:
    """Read what `write_exposures` wrote; None if the photographs hardly differ.

    Raises:
        InputError: the file is missing or damaged.
    """
    exposures = read_exposures(folder)
    return exposures if largest_difference(exposures) > NOTICEABLE else None


def largest_difference(exposures: Mapping[str, Float[np.ndarray, "3"]]) -> float:
    """The largest difference between two photographs in one channel, stops."""
    return float(np.ptp(np.stack(list(exposures.values())), axis=0).max()) if exposures else 0.0


def equalised(picture: UInt8[np.ndarray, "height width 3"], exposure: Float[np.ndarray, "3"]) -> np.ndarray:
    """The photograph at the median exposure; what is burnt out stays without detail."""
    light = linear_samples(np.arange(256, dtype=np.uint8))[:, None] * 2.0**-exposure
    table = srgb_samples(np.rint(light).clip(0, FULL).astype(np.uint16), picture.dtype)
    return np.stack([table[picture[..., channel], channel] for channel in range(3)], axis=-1)
