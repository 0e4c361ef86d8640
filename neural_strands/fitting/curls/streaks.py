"""The texture of curly hair in a picture: how streaks lean off the hair's course, and how often that repeats.

Where single curls cannot be told apart, these statistics still show how large they are: the lean of the streaks tells
how steep a curl is, its repetition along the hair how long a turn is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import segments
from neural_strands.lmvs.orientation import OrientationConfig, OrientationMap, orientation_map
from neural_strands.raster.dilation import widen
from neural_strands.raster.gaussian_blur import gaussian_blur
from neural_strands.raster.lines import rasterise_lines

BINS = 36
"""Bins of the histogram of leans, over half a circle."""
LAGS = tuple(0.002 * k for k in range(36))
"""Distances along the hair at which the texture is compared with itself, metres."""
SMOOTH = 3.0
"""Standard deviation of the blur of the drawn course, pixels."""
COHERENT = 0.8
"""Least length of the mean doubled direction of the course within that blur."""
EVERY = 3
"""One in this many pixels is compared with those further along."""
WHITENING = 0.02
"""Depth behind the foremost hair nearby at which drawn hair is darker by a factor e, metres."""
NEARBY = 21
"""Window in which the foremost hair is searched, in pixels of the drawing."""
BLUR = 1.5
"""Standard deviation of the blur of histograms that are compared, bins."""
COMPARED_LAGS = slice(5, 28)
"""Lags at which repetition is compared: nearer pixels are alike in any hair, and farther on the decay is uncertain."""
TREND = 3.0
"""Standard deviation of the blur that tells turns from the slow decay of the repetition, lags."""


@dataclass(frozen=True)
class Course:
    """The course of the hair in a picture.

    Attributes:
        angle: projected direction, radians from the image's x axis towards its y axis, modulo pi.
        depth: along the optical axis, metres.
        known: where there is hair whose neighbours run alike.
    """

    angle: Float[Tensor, "height width"]
    depth: Float[Tensor, "height width"]
    known: Bool[Tensor, "height width"]


@dataclass(frozen=True)
class Texture:
    """Statistics of the streaks in a picture, relative to the course of the hair.

    Attributes:
        lean: histogram of the angle between streaks and course, from -pi / 2 to pi / 2 clockwise; sums to 1.
        repetition: correlation of the streaks with those further along the course, at `LAGS`; 1 at the first.
    """

    lean: Float[Tensor, " bin"]
    repetition: Float[Tensor, " lag"]

    def difference(self, other: "Texture", repetition: float) -> float:
        """How much two textures differ, 0 if they are the same; `repetition` is its weight against the lean."""
        return self.lean_difference(other) + repetition * self.repetition_difference(other)

    def lean_difference(self, other: "Texture") -> float:
        """Share of the streaks that would have to lean otherwise, from 0 to 1."""
        return 0.5 * float((self._leans() - other._leans()).abs().sum())

    def repetition_difference(self, other: "Texture") -> float:
        """How differently turns follow each other: 0 if alike, 1 if unrelated, 2 if opposite."""
        # How regular turns are does not count, nor how far locks look alike.
        return 1 - float(functional.cosine_similarity(self._turns(), other._turns(), dim=0))

    def _leans(self) -> Float[Tensor, " bin"]:
        """The blurred histogram without what all angles have in common: noise has streaks of any direction."""
        blurred = gaussian_blur(self.lean[None], BLUR)[0]
        above = blurred - blurred.min()
        return above / above.sum().clamp(min=1e-9)

    def _turns(self) -> Float[Tensor, " compared"]:
        """The repetition at `COMPARED_LAGS` without its slow decay."""
        repetition = self.repetition.double()
        place = torch.arange(len(repetition)).to(repetition)
        blur = torch.exp(-0.5 * ((place[:, None] - place) / TREND).square())
        slow = blur @ repetition / blur.sum(dim=1)
        return (repetition - slow)[COMPARED_LAGS]


def course_of(axes: Float[Tensor, "strand point 3"], camera: Camera) -> Course:
    """Draw the course of the hair from strands that follow it without curls."""
    buffer = rasterise_lines(axes, camera)
    hit = (buffer.segment >= 0).float()
    first, _ = camera.project(axes[:, :-1].reshape(-1, 3))
    last, _ = camera.project(axes[:, 1:].reshape(-1, 3))
    along = (last - first)[buffer.segment.clamp(min=0)]
    angle = torch.atan2(along[..., 1], along[..., 0])
    depth = torch.where(hit > 0, buffer.depth, 0.0)
    drawn = torch.stack([hit, hit * torch.cos(2 * angle), hit * torch.sin(2 * angle), depth])
    weight, cosine, sine, depth = gaussian_blur(drawn, SMOOTH)
    coherence = torch.hypot(cosine, sine) / weight.clamp(min=1e-6)
    known = (weight > 0.3) & (coherence > COHERENT)
    return Course(0.5 * torch.atan2(sine, cosine), depth / weight.clamp(min=1e-6), known)


def drawn_hair(
    strands: Float[Tensor, "strand point 3"], camera: Camera, random: torch.Generator
) -> Float[Tensor, "height width"]:
    """Brightness of hair drawn as lines: strands of random brightness, darker behind the foremost."""
    large = camera.resized(2 * camera.width, 2 * camera.height)
    buffer = rasterise_lines(strands, large)
    hit = buffer.segment >= 0
    owner = buffer.segment.clamp(min=0) // segments(strands).shape[1]
    brightness = (0.3 + 0.4 * torch.rand(len(strands), generator=random)).to(strands)[owner]
    depth = torch.where(hit, buffer.depth, 1e3)
    foremost = -widen(-depth, NEARBY // 2)
    shaded = torch.where(hit, brightness * torch.exp((foremost - depth) / WHITENING), 0.0)
    return functional.avg_pool2d(shaded[None, None], 2)[0, 0]


def texture_of(
    pictures: Sequence[Float[Tensor, "height width"]],
    masks: Sequence[Float[Tensor, "height width"]],
    courses: Sequence[Course],
    cameras: Sequence[Camera],
    config: OrientationConfig,
) -> Texture:
    """Measure the texture of the hair in some pictures together.

    Args:
        pictures: brightness of each.
        masks: coverage of hair.
        courses: course of the hair in each.
        cameras: their cameras.
        config: the orientation filters.
    """
    lean, product, weight = torch.zeros(BINS), torch.zeros(len(LAGS)), torch.zeros(len(LAGS))
    for picture, mask, course, camera in zip(pictures, masks, courses, cameras, strict=True):
        seen = orientation_map(picture, config)
        trust = (seen.confidence * (course.known & (mask > 0.5))).cpu()
        off = (seen.angle - course.angle).cpu()
        wrapped = torch.rad2deg((off + math.pi / 2).remainder(math.pi)) - 90
        lean += torch.histogram(wrapped.flatten(), BINS, range=(-90.0, 90.0), weight=trust.flatten()).hist
        some_product, some_weight = _repetition(seen, course, trust, camera)
        product, weight = product + some_product, weight + some_weight
    repetition = product / weight.clamp(min=1e-9)
    return Texture(lean / lean.sum().clamp(min=1e-9), repetition / repetition[0].clamp(min=1e-9))


def _repetition(
    seen: OrientationMap, course: Course, trust: Float[Tensor, "height width"], camera: Camera
) -> tuple[Float[Tensor, " lag"], Float[Tensor, " lag"]]:
    """Products of the streaks' deviations from their mean with those further along the course, and their weights."""
    off = 2 * (seen.angle - course.angle).cpu()
    streaks = torch.stack([off.cos(), off.sin()], dim=-1)
    mean = (streaks * trust[..., None]).sum(dim=(0, 1)) / trust.sum().clamp(min=1e-9)
    streaks = (streaks - mean) * trust[..., None]
    row, column = (index[::EVERY] for index in torch.nonzero(trust > 0, as_tuple=True))
    angle, depth = course.angle.cpu()[row, column], course.depth.cpu()[row, column]
    height, width = trust.shape
    product, weight = torch.zeros(len(LAGS)), torch.zeros(len(LAGS))
    for k, lag in enumerate(LAGS):
        pixels = lag * float(camera.intrinsics[0, 0]) / depth
        there = (row + pixels * angle.sin()).round().long(), (column + pixels * angle.cos()).round().long()
        inside = (there[0] >= 0) & (there[0] < height) & (there[1] >= 0) & (there[1] < width)
        here = row[inside], column[inside]
        there = there[0][inside], there[1][inside]
        product[k] = (streaks[here] * streaks[there]).sum()
        weight[k] = (trust[here] * trust[there]).sum()
    return product, weight
