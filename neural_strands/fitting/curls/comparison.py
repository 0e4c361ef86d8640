"""Comparison of photographs with drawn hair, by the texture of their streaks; and the curl whose drawing is closest."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.fitting.curls.streaks import Course, Texture, course_of, drawn_hair, texture_of
from neural_strands.fitting.noise import NOISY, clearness
from neural_strands.flow.curls import Curl, CurlConfig, Locks, curled
from neural_strands.foundation.progress import Steps, Track, untracked
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import Views
from neural_strands.lmvs.orientation import OrientationConfig, luma

MOST_STRANDS = 5000
"""Largest number of strands that are drawn."""
MOST_VIEWS = 4
"""Largest number of views that hair drawn with curls is compared with."""
LARGEST_SIDE = 512
"""Photographs are reduced to this size for the comparison, pixels."""
SLOPES = (0.4, 0.55, 0.7, 0.9, 1.12, 1.4, 1.75)
"""Slopes of curls that are tried: 2 pi radius / pitch."""
PITCHES = (0.012, 0.0155, 0.02, 0.024, 0.028, 0.034, 0.04, 0.05)
"""Lengths of a turn that are tried, metres; longer ones would not repeat within the lags that are compared."""
FOR_SIZE, FOR_CURLINESS = 1.0, 0.25
"""Weight of the repetition of textures against their lean: for the size of curls, and for whether there are any. Curls
of several sizes may have the same lean, but noise hides how they repeat."""
BURIED = 0.075
"""Clearness of photographs (see `fitting.noise`) up to which the amount of noise cannot be told from that of others."""
MOST_NOISE, BISECTIONS = 4.0, 8
"""Largest noise of drawings, and steps of the search for it."""
WAVE_ROUNDNESS = 0.5
"""Roundness of waves."""


@dataclass(frozen=True)
class Photographs:
    """Photographs with which drawn hair is compared.

    Attributes:
        cameras: cameras of the reduced pictures.
        brightness: the pictures.
        masks: coverage of hair.
    """

    cameras: Sequence[Camera]
    brightness: Sequence[Float[Tensor, "height width"]]
    masks: Sequence[Float[Tensor, "height width"]]


@dataclass(frozen=True)
class Comparison:
    """Drawn hair beside photographs.

    Attributes:
        photographs: the photographs.
        axes: strands that follow the course of the hair.
        courses: that course in each photograph.
        seen: texture of the photographs.
    """

    photographs: Photographs
    axes: Float[Tensor, "strand point 3"]
    courses: Sequence[Course]
    seen: Texture

    @classmethod
    def along(cls, axes: Float[Tensor, "strand point 3"], photographs: Photographs) -> "Comparison":
        """Measure the texture of photographs relative to strands that follow the course of the hair."""
        courses = [course_of(axes, camera) for camera in photographs.cameras]
        return cls(photographs, axes, courses, _texture(photographs.brightness, photographs, courses))

    def of(self, strands: Float[Tensor, "strand point 3"], noise: float = 0.0) -> Texture:
        """Texture of drawn strands relative to the same course, in noise of this standard deviation."""
        return _texture(in_noise(self._drawn(strands), noise), self.photographs, self.courses)

    def noise(self) -> float:
        """Noise in which the axes, drawn, have streaks as clear as the photographs'.

        It is 0 if these are not noisy, or if noise hides all of their streaks. Otherwise it is a standard deviation, in
        units of the brightness of drawn hair in full light.
        """
        wanted = self._clearness(self.photographs.brightness)
        if not BURIED < wanted < NOISY:
            return 0.0
        drawn, low, high = self._drawn(self.axes), 0.0, MOST_NOISE
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._clearness(in_noise(drawn, middle)) > wanted else (low, middle)
        return high

    def _drawn(self, strands: Float[Tensor, "strand point 3"]) -> list[Float[Tensor, "height width"]]:
        random = torch.Generator().manual_seed(0)
        return [drawn_hair(strands, camera, random) for camera in self.photographs.cameras]

    def _clearness(self, pictures: Sequence[Float[Tensor, "height width"]]) -> float:
        """Mean clearness of pictures from the cameras of the photographs; 1 without hair."""
        pairs = zip(pictures, self.photographs.masks, strict=True)
        found = [clearness(picture, mask, OrientationConfig()) for picture, mask in pairs]
        known = [each for each in found if each is not None]
        return statistics.fmean(known) if known else 1.0


@dataclass(frozen=True)
class DrawnCurl:
    """Hair drawn with a curl, beside the photographs.

    Attributes:
        curl: the curl.
        texture: texture of the drawing.
        seen: texture of the photographs.
    """

    curl: Curl
    texture: Texture
    seen: Texture

    def difference(self, repetition: float) -> float:
        """How much they differ, as by `Texture.difference`."""
        return self.texture.difference(self.seen, repetition)


def photographs(views: Views, most: int = MOST_VIEWS) -> Photographs:
    """At most so many photographs from all around, reduced to the size at which they are compared."""
    masked = [index for index, has in enumerate(views.has_hair_mask) if has]
    chosen = masked[:: max(1, len(masked) // most)][:most]
    cameras, brightness, masks = [], [], []
    for view in (views[index] for index in chosen):
        if view.hair_mask is None:
            continue
        scale = min(1.0, LARGEST_SIDE / max(view.camera.width, view.camera.height))
        small = view.camera.resized(round(scale * view.camera.width) or 1, round(scale * view.camera.height) or 1)
        layers = torch.stack([luma(view.image), view.hair_mask])[None]
        picture, mask = functional.interpolate(layers, (small.height, small.width), mode="area")[0]
        cameras.append(small)
        brightness.append(picture)
        masks.append(mask)
    return Photographs(cameras, brightness, masks)


def closest_curl(
    comparison: Comparison,
    normals: Float[Tensor, "strand 3"],
    turn: int,
    config: CurlConfig,
    pitches: Sequence[float] = PITCHES,
    track: Track = untracked,
) -> DrawnCurl:
    """The curl whose drawing has the texture closest to the photographs'.

    Args:
        comparison: the photographs, and strands along the axes of the curls.
        normals: outward unit normals at the roots of those strands.
        turn: handedness of the curls; 0 for waves.
        config: size of the locks that curl in phase.
        pitches: lengths of a turn to try, metres.
        track: shows the progress of the search.
    """
    locks = Locks.drawn(comparison.axes[:, 0], config.lock)
    tried: dict[tuple[float, float], Texture] = {}

    def size(slope: float, pitch: float) -> Curl:
        return Curl(slope * pitch / (2 * math.pi), pitch, turn, 1.0 if turn else WAVE_ROUNDNESS)

    steps = Steps(track, f"drawing {'curls' if turn else 'waves'}", 2 * len(SLOPES) + len(pitches))

    def texture(slope: float, pitch: float) -> Texture:
        if (slope, pitch) not in tried:
            tried[slope, pitch] = comparison.of(curled(comparison.axes, normals, locks, size(slope, pitch)))
        steps.done()
        return tried[slope, pitch]

    seen = comparison.seen
    # The lean depends on the slope and hardly on the pitch, so the two can be searched in turn.
    slope = min(SLOPES, key=lambda slope: texture(slope, pitches[len(pitches) // 2]).lean_difference(seen))
    pitch = min(pitches, key=lambda pitch: texture(slope, pitch).difference(seen, FOR_SIZE))
    slope = min(SLOPES, key=lambda slope: texture(slope, pitch).difference(seen, FOR_SIZE))
    return DrawnCurl(size(slope, pitch), tried[slope, pitch], seen)


def _texture(
    pictures: Sequence[Float[Tensor, "height width"]], seen: Photographs, courses: Sequence[Course]
) -> Texture:
    """Texture of pictures from the cameras of the photographs."""
    return texture_of(pictures, seen.masks, courses, seen.cameras, OrientationConfig())


def in_noise(
    pictures: Sequence[Float[Tensor, "height width"]], noise: float
) -> Sequence[Float[Tensor, "height width"]]:
    """Pictures with noise of this standard deviation, the same at every call."""
    random = torch.Generator().manual_seed(1)
    return [picture + noise * torch.randn(picture.shape, generator=random).to(picture) for picture in pictures]
