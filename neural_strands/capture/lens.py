"""Lens distortion, which is undone once, when an image is decoded.

The model is OpenCV's (and COLMAP's OPENCV): radial k1, k2, k3 and tangential p1, p2 on normalised coordinates.
Intrinsics here follow the project (pixel centres at +0.5); OpenCV's own functions put centres at whole numbers, so
half a pixel is subtracted on the way in.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from neural_strands.foundation.image_files import MOST_PIXELS

ZOOM_RANGE = (0.5, 2.0)
"""Bounds of the ratio between the focal lengths of the undistorted view and the lens."""
FOCAL_RANGE = (0.01, 10_000.0)
"""Plausible focal lengths, in multiples of the image's longer side."""
FARTHEST_CENTRE = 100.0
"""Largest distance of the principal point from the image's corner, in image sides: that of crops is far outside."""
BAND = 256
"""Rows that are resampled at once."""
MOST_DISTORTION = 1000.0
"""Largest coefficient; the one of the sixth power is large for long lenses."""


@dataclass(frozen=True)
class Lens:
    """A calibrated lens with distortion.

    Attributes:
        intrinsics: fx, fy, cx, cy in pixels, pixel centres at +0.5.
        coefficients: k1, k2, p1, p2, k3 (OpenCV's order), dimensionless.
        width: image width in pixels.
        height: image height in pixels.

    Raises:
        ValueError: the size, focal length, centre or distortion is impossible.
    """

    intrinsics: tuple[float, float, float, float]
    coefficients: tuple[float, float, float, float, float]
    width: int
    height: int

    def __post_init__(self) -> None:
        side = max(self.width, self.height)
        fx, fy, cx, cy = self.intrinsics
        if not all(math.isfinite(value) for value in (*self.intrinsics, *self.coefficients)):
            raise ValueError("finite parameters, found NaN or infinity")
        if min(self.width, self.height) < 1 or self.width * self.height > MOST_PIXELS:
            raise ValueError(f"a positive size of at most {MOST_PIXELS} pixels, found {self.width} x {self.height}")
        low, high = FOCAL_RANGE
        if not low * side <= min(fx, fy) <= max(fx, fy) <= high * side:
            raise ValueError(f"a focal length of {low} to {high} image widths, found {fx:g} and {fy:g} pixels")
        if not max(abs(cx), abs(cy)) <= FARTHEST_CENTRE * side:
            raise ValueError(f"a centre near the image, found {cx:g}, {cy:g}")
        if not max(abs(value) for value in self.coefficients) <= MOST_DISTORTION:
            raise ValueError(f"distortion of at most {MOST_DISTORTION:g}, found {max(self.coefficients, key=abs):g}")

    @property
    def distorts(self) -> bool:
        """Whether any coefficient differs from zero."""
        return any(self.coefficients)

    def matrix(self, zoom: float = 1.0) -> np.ndarray:
        """The 3 x 3 intrinsics, focal lengths multiplied by `zoom`."""
        fx, fy, cx, cy = self.intrinsics
        return np.array([[fx * zoom, 0.0, cx], [0.0, fy * zoom, cy], [0.0, 0.0, 1.0]])

    def undistorted_zoom(self) -> float:
        """The smallest zoom at which every pixel of the undistorted view lies inside the photograph."""
        if not self.distorts:
            return 1.0
        low, high = ZOOM_RANGE
        if not self._covered(high):
            return 1.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self._covered(middle) else (middle, high)
        return high

    def undistorted_matrix(self) -> np.ndarray:
        """Intrinsics of the pinhole view that `undistort` returns: same size, same principal point."""
        return self.matrix(self.undistorted_zoom())

    def distort(self, normalised: np.ndarray) -> np.ndarray:
        """Pixels at which the lens images normalised pinhole coordinates (..., 2)."""
        k1, k2, p1, p2, k3 = self.coefficients
        fx, fy, cx, cy = self.intrinsics
        x, y = normalised[..., 0], normalised[..., 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        distorted_x = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        distorted_y = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return np.stack([fx * distorted_x + cx, fy * distorted_y + cy], axis=-1)

    def undistort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of the undistorted view for pixels of the photograph; the inverse of `distort`."""
        if not self.distorts or len(pixels) == 0:
            return pixels
        matrix, k1, k2, p1, p2, k3 = self.matrix(), *self.coefficients
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        points = np.ascontiguousarray(pixels, dtype=np.float64)[:, None]
        found = cv2.undistortPoints(
            points, matrix, np.array([k1, k2, p1, p2, k3]), P=self.undistorted_matrix(), criteria=criteria
        )
        return np.asarray(found).reshape(-1, 2)

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """Resample a photograph (height, width[, channel]) to the pinhole view of `undistorted_matrix`."""
        if not self.distorts:
            return image
        zoom, across = self.undistorted_zoom(), np.arange(self.width) + 0.5
        bands = []
        # The coordinates of all pixels at once would take far more memory than the picture.
        for top in range(0, self.height, BAND):
            columns, rows = np.meshgrid(across, np.arange(top, min(top + BAND, self.height)) + 0.5)
            source = (self.distort(self._normalised(columns, rows, zoom)) - 0.5).astype(np.float32)
            bands.append(
                cv2.remap(image, source[..., 0], source[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            )
        return np.concatenate(bands)

    def _normalised(self, columns: np.ndarray, rows: np.ndarray, zoom: float) -> np.ndarray:
        fx, fy, cx, cy = self.intrinsics
        return np.stack([(columns - cx) / (fx * zoom), (rows - cy) / (fy * zoom)], axis=-1)

    def _covered(self, zoom: float) -> bool:
        """Whether the border of the undistorted view falls inside the photograph at this zoom."""
        across, down = np.linspace(0, self.width, 33), np.linspace(0, self.height, 33)
        columns = np.concatenate([across, across, np.zeros(33), np.full(33, self.width)])
        rows = np.concatenate([np.zeros(33), np.full(33, self.height), down, down])
        source = self.distort(self._normalised(columns, rows, zoom))
        size = np.array([self.width, self.height])
        return bool(((source >= 0) & (source <= size)).all())
