"""Settings of a fit (sizes, loss weights, learning rates) and the presets of the command line."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

from neural_strands.capture.hold_out import HOLD_OUT_EVERY
from neural_strands.fitting.losses import ChamferConfig
from neural_strands.fitting.noise import NoiseConfig
from neural_strands.fitting.photographs.streak_loss import StreakConfig
from neural_strands.fitting.photographs.trimap import TrimapConfig
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.flow.hair_flow import InitialConfig
from neural_strands.foundation.configs import Between, check_config, config_from_json, read_settings
from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.lmvs.growth import GrowthConfig
from neural_strands.lmvs.reconstruct import LmvsConfig
from neural_strands.model.hair_model import HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.unet import UNetConfig

Preset = Literal["demo", "fast", "paper"]

LARGEST_TEXTURE = 2**28
"""Largest number of values in a scalp texture: one gigabyte, and three more for its gradient and Adam's moments."""
LARGEST_STRANDS = 2**28
"""Largest number of coordinates of all strands together."""

KNOTTED = ScalpTextureConfig(appearance_size=256, appearance_knots=8)
"""Coarser texels than those of the paper's appearance texture, but with eight descriptors along each strand."""


@dataclass(frozen=True)
class FitWeights:
    """Weights of the losses, which are all means (see `losses`).

    The paper's losses are sums: over points with weight 1, over pixels with weight 1e-3. With P generated points and Q
    pixels per step, this corresponds to weights for means of 1 for geometry and 1e-3 Q / P for image and alpha.
    """

    geometry: Annotated[float, Between(0, 1e6)] = 1.0
    """Two-way Chamfer against the line segments, distances in `ChamferConfig.unit`."""
    render: Annotated[float, Between(0, 1e6)] = 1.0
    """Squared error of the colours."""
    perceptual: Annotated[float, Between(0, 1e6)] = 0.04
    """LPIPS, as part of the rendering loss (the paper: 0.1, with sums over pixels)."""
    alpha: Annotated[float, Between(0, 1e6)] = 0.5
    """Squared opacity error on the trimap."""
    streaks: Annotated[float, Between(0, 1e6)] = 60.0
    """Sine of the angle between visible strands and the photographs' streaks, times the streaks' confidence."""
    head: Annotated[float, Between(0, 1e6)] = 1.0
    """Depth of strands inside the head."""
    first: Annotated[float, Between(0, 1e6)] = 0.05
    """Distance of points that views see from where they started, if strands were traced. Segments are sparse; without
    this term strands gather at them and leave gaps in between."""
    hidden: Annotated[float, Between(0, 1e6)] = 0.5
    """The same of points that no view sees. They move only because seen points of the same strand, or of others that
    share its texels, are pulled."""
    shape_from_image: Annotated[float, Between(0, 1e6)] = 0.05
    """Factor on the image and alpha gradients that reach the shape texture; 0 leaves the shape to the geometric
    loss."""


@dataclass(frozen=True)
class FitRates:
    """Adam's learning rates, before the factor of the schedule."""

    shape: Annotated[float, Between(0, 10)] = 4e-3
    """Z_g, in units of the prior's latent (about 1 across hair)."""
    appearance: Annotated[float, Between(0, 10)] = 5e-3
    """Z_a."""
    settled_appearance: Annotated[float, Between(0, 10)] = 2e-3
    """Z_a once strands keep their shape: it then starts near the photographs."""
    network: Annotated[float, Between(0, 10)] = 2e-3
    """Weights of the UNet and the point shader."""
    grain: Annotated[float, Between(0, 10)] = 6e-2
    """Strength of the grain."""
    surround: Annotated[float, Between(0, 10)] = 1e-4
    """Colours of the body. They start in closed form, and at a higher rate they gather noise."""


@dataclass(frozen=True)
class FitConfig:
    """The complete settings of one fit, saved with its results and compared when it resumes.

    Examples:
        >>> from dataclasses import replace
        >>> import neural_strands as ns
        >>> config = ns.FitConfig(steps=1000)
        >>> replace(config, weights=replace(config.weights, alpha=0.3)).weights.alpha
        0.3
    """

    steps: Annotated[int, Between(1, 10_000_000)] = 2500
    """Number of optimisation steps."""
    strands: Annotated[int, Between(1, 1_000_000)] = 10_000
    """Strands in the result, one per root."""
    strands_per_step: Annotated[int, Between(1, 1_000_000)] = 2500
    """Strands whose shape one step updates."""
    step_points: Annotated[int, Between(2, 1000)] = 50
    """Points per strand in the geometric loss (the result has `model.points`)."""
    targets_per_step: Annotated[int, Between(1, 10_000_000)] = 60_000
    """Points of the line segments used in one step."""
    crop: Annotated[int, Between(16, 8192)] = 160
    """Side of the square image region of one step, pixels; smaller images are used whole."""
    margin: Annotated[int, Between(0, 1000)] = 8
    """Pixels at a region's border that carry no loss."""
    largest_gradient: Annotated[float, Between(1e-9, 1e6)] = 0.05
    """Norm to which the gradient of the networks is clipped."""
    views_per_step: Annotated[int, Between(1, 1000)] = 1
    """Image regions per step, divided between processes."""
    shape_every: Annotated[int, Between(0, 1_000_000)] = 8
    """After the geometry-only phase, the shape is updated once in this many steps; the others train only the
    appearance. 0: never."""
    hold_out_every: Annotated[int, Between(0, 1_000_000)] = HOLD_OUT_EVERY
    """One view in this many is held out and used only for evaluation; 0 holds out none."""
    correct_masks: bool = True
    """Grow or shrink the hair masks if the photographs show that the hair ends elsewhere."""
    initialise: Literal["flow", "mean"] = "flow"
    """Initial strands: traced through the flow of the segments, or the prior's mean strand everywhere (the paper)."""
    networks: Literal["learned", "random"] = "learned"
    """Initial weights of the image generator and the point shader: learned from synthetic hair, where the package has
    some of the right sizes, or random (the paper)."""
    clearance: Annotated[float, Between(0, 1)] = 0.001
    """Distance that strands keep from the head, metres."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of all random numbers."""
    weights: FitWeights = field(default_factory=FitWeights)
    """Weights of the losses."""
    rates: FitRates = field(default_factory=FitRates)
    """Learning rates."""
    schedule: ScheduleConfig = field(
        default_factory=lambda: ScheduleConfig(
            widest_blur=2.0,
            release_until=0.0,
            geometry_only=0.1,
            perceptual_from=0.25,
            settled_from=0.5,
            final_rate=0.02,
        )
    )
    """Coarse to fine, root to tip, and the start of image losses. Traced initial strands need little of these."""
    chamfer: ChamferConfig = field(default_factory=ChamferConfig)
    """The geometric loss."""
    streaks: StreakConfig = field(default_factory=StreakConfig)
    """Comparison with the photographs' streaks."""
    trimap: TrimapConfig = field(default_factory=TrimapConfig)
    """The alpha loss."""
    stereo: LmvsConfig = field(default_factory=lambda: LmvsConfig(confirming=1.4, complete="never"))
    """Line-based stereo, if no segments are given. Guessed segments would mislead the flow through which the initial
    strands are traced; lines confirmed by little more than one other view are rarely wrong, and the flow needs them."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """When the stereo runs again because noise hides the streaks of straight hair."""
    growth: GrowthConfig = field(default_factory=GrowthConfig)
    """Signing those segments from root to tip."""
    initial: InitialConfig = field(default_factory=InitialConfig)
    """Initial strands."""
    model: HairModelConfig = field(default_factory=lambda: HairModelConfig(textures=KNOTTED))
    """Textures, UNet, body and background."""


def preset(name: str) -> FitConfig:
    """The settings of a preset: `demo` for minutes on two cores, `fast` for half an hour, `paper` for one GPU.

    The shape texture has at least six texels per strand. With 2.7 it cannot represent neighbours separately: decoded
    strands are 1.7 to 3 mm away from the traced ones.

    Raises:
        InputError: no preset has that name.

    Examples:
        >>> import neural_strands as ns
        >>> ns.preset("demo").steps, ns.preset("fast").steps, ns.preset("paper").steps
        (400, 2500, 12000)
    """
    if name not in get_args(Preset):
        raise InputError(
            f"preset: expected one of {', '.join(get_args(Preset))}, found {excerpt(name)}; name one of these."
        )
    small = HairModelConfig(
        textures=ScalpTextureConfig(appearance_size=128, appearance_knots=4),
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
                textures=ScalpTextureConfig(shape_size=512, appearance_knots=4),
                unet=UNetConfig(widths=(32, 64, 96, 128)),
            ),
        ),
    }
    return configs[name]


def read_fit_config(path: Path, base: FitConfig) -> FitConfig:
    """Read settings from a run's `run.json`, or from JSON or TOML; settings that the file omits are those of `base`.

    Raises:
        InputError: the file cannot be read, or a setting in it is unknown, of the wrong type or out of bounds.
    """
    document = read_settings(path)
    config = config_from_json(base, document.member("config") if "format" in document.members() else document)
    check_fit_config(config, str(path))
    return config


def check_fit_config(config: FitConfig, source: str = "config") -> None:
    """Refuse settings that no fit can run with.

    Args:
        config: the settings.
        source: the file or option that they come from, for error messages.

    Raises:
        InputError: a setting, which the message names, is impossible.
    """
    check_config(config, source)
    textures, smallest = config.model.textures, 2 * config.margin + config.model.unet.stride
    if config.crop < smallest:
        expected = f"at least {smallest} pixels (two margins and a pixel of the coarsest level)"
        raise InputError(f"{source}: crop: expected {expected}, found {config.crop}; give another value.")
    sizes = {
        "model.textures.shape_size": (textures.shape_size**2 * textures.shape_channels, LARGEST_TEXTURE),
        "model.textures.appearance_size": (
            textures.appearance_size**2 * textures.appearance_channels * textures.appearance_knots,
            LARGEST_TEXTURE,
        ),
        "strands": (config.strands * config.model.points * 3, LARGEST_STRANDS),
    }
    for name, (found, most) in sizes.items():
        if found > most:
            raise InputError(
                f"{source}: {name}: expected {most} numbers in all or fewer, found {found}; make it smaller."
            )
