"""Settings of a fit: sizes, weights, rates; and the presets of the command line."""

from dataclasses import dataclass, field, replace
from typing import Literal

from neural_strands.capture.hold_out import HOLD_OUT_EVERY
from neural_strands.fitting.first_strands import InitialConfig
from neural_strands.fitting.losses import ChamferConfig
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.fitting.trimap import TrimapConfig
from neural_strands.lmvs.growth import GrowthConfig
from neural_strands.lmvs.reconstruct import LmvsConfig
from neural_strands.model.hair_model import HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.unet import UNetConfig

Preset = Literal["demo", "fast", "paper"]

KNOTTED = ScalpTextureConfig(appearance_size=256, appearance_knots=4)
"""As many numbers as the paper's appearance texture, but four descriptors along each strand instead of finer texels."""


@dataclass(frozen=True)
class FitWeights:
    """Weights of the losses, which are all means (see `losses`).

    The paper sums: 1 x over points, 1e-3 x over pixels. With P generated points and Q pixels a step, its weights for
    means are 1 for geometry and 1e-3 Q / P for image and alpha.
    """

    geometry: float = 1.0
    """Two-way Chamfer against the line segments, distances in `ChamferConfig.unit`."""
    render: float = 1.0
    """Squared colour error."""
    perceptual: float = 0.04
    """LPIPS, within the rendering loss (the paper: 0.1, with a sum over pixels)."""
    alpha: float = 0.5
    """Squared opacity error on the trimap."""
    head: float = 1.0
    """Depth of strands inside the head."""
    first: float = 0.05
    """Distance of strands from their start, if they are traced. Segments are sparse, and without this term strands
    gather at them and leave gaps between."""
    shape_from_image: float = 0.05
    """Factor of image and alpha gradients that reach the shape texture; 0 leaves the shape to the geometric loss."""


@dataclass(frozen=True)
class FitRates:
    """Adam's learning rates before the schedule's factor."""

    shape: float = 4e-3
    """Z_g, in units of the prior's latent (about 1 across hair)."""
    appearance: float = 5e-3
    """Z_a."""
    network: float = 2e-3
    """Weights of the UNet and the point shader."""
    surround: float = 1e-3
    """Colours of body and background."""


@dataclass(frozen=True)
class FitConfig:
    """The resolved settings of one fit, saved with its results and compared on resume."""

    steps: int = 5000
    """Number of optimisation steps."""
    strands: int = 10_000
    """Strands in the result, one per root."""
    strands_per_step: int = 2500
    """Strands whose shape one step updates."""
    step_points: int = 50
    """Points per strand in the geometric loss (the result has `model.points`)."""
    targets_per_step: int = 60_000
    """Points of the line segments that one step sees."""
    crop: int = 160
    """Side of the square image region of one step, pixels; images no larger are taken whole."""
    margin: int = 8
    """Pixels at a region's border that carry no loss."""
    largest_gradient: float = 0.05
    """Norm to which the gradient of the networks is clipped."""
    views_per_step: int = 1
    """Image regions per step, divided between processes."""
    shape_every: int = 8
    """After the geometry-only phase the shape moves once in this many steps; other steps train only the appearance. 0:
    never."""
    hold_out_every: int = HOLD_OUT_EVERY
    """One view in this many is held out for evaluation and seen by nothing else; 0 holds out none."""
    initialise: Literal["flow", "mean"] = "flow"
    """First strands: traced through the flow of the segments, or the prior's mean strand everywhere (the paper)."""
    clearance: float = 0.001
    """Distance that strands keep from the head, metres."""
    seed: int = 0
    """Seed of everything random."""
    weights: FitWeights = field(default_factory=FitWeights)
    """Weights of the losses."""
    rates: FitRates = field(default_factory=FitRates)
    """Learning rates."""
    schedule: ScheduleConfig = field(
        default_factory=lambda: ScheduleConfig(
            widest_blur=2.0, release_until=0.0, geometry_only=0.1, perceptual_from=0.6, final_rate=0.02
        )
    )
    """Coarse to fine, root to tip, and the start of image losses. Traced first strands need little of these."""
    chamfer: ChamferConfig = field(default_factory=ChamferConfig)
    """The geometric loss."""
    trimap: TrimapConfig = field(default_factory=TrimapConfig)
    """The alpha loss."""
    stereo: LmvsConfig = field(default_factory=lambda: LmvsConfig(confirming=1.4, complete="never"))
    """Line segments, where none are given. Guesses would mislead the flow that first strands are traced through; lines
    that little more than one other view confirms are rarely wrong, and the flow needs them."""
    growth: GrowthConfig = field(default_factory=GrowthConfig)
    """Which way those segments run, from root to tip."""
    initial: InitialConfig = field(default_factory=InitialConfig)
    """First strands."""
    model: HairModelConfig = field(default_factory=lambda: HairModelConfig(textures=KNOTTED))
    """Textures, UNet, body and background."""


def preset(name: Preset) -> FitConfig:
    """The settings of a preset: `demo` for minutes on two cores, `fast` for an hour, `paper` for one GPU."""
    small = HairModelConfig(
        textures=ScalpTextureConfig(shape_size=128, appearance_size=128, appearance_knots=4),
        unet=UNetConfig(widths=(12, 24, 32)),
    )
    configs = {
        "demo": FitConfig(steps=400, strands=6000, strands_per_step=2000, step_points=40, crop=128, model=small),
        "fast": FitConfig(),
        "paper": replace(
            FitConfig(),
            steps=12_000,
            strands=30_000,
            strands_per_step=6000,
            step_points=100,
            targets_per_step=200_000,
            crop=1024,
            shape_every=2,
            model=HairModelConfig(
                textures=ScalpTextureConfig(appearance_knots=4), unet=UNetConfig(widths=(32, 64, 96, 128))
            ),
        ),
    }
    return configs[name]
