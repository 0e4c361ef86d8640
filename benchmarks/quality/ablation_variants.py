"""The variants of `ablations.py`: settings of fits that differ from the full one in one thing."""

from dataclasses import dataclass, replace
from pathlib import Path

from neural_strands.fitting.config import FitConfig, preset
from neural_strands.fitting.schedule import ScheduleConfig

SHORT_CROP = 128
"""Side of a step's image region in runs with fewer steps than the preset's, pixels."""


@dataclass(frozen=True)
class Variant:
    """One row of the table.

    Attributes:
        config: of its fit.
        prior: weights of its strand prior, if they are not the package's.
        stereo: whether it starts from line segments of the stereo; otherwise from hair that hangs from the scalp.
    """

    config: FitConfig
    prior: Path | None = None
    stereo: bool = True


def full_config(name: str, steps: int, crop: int | None, seed: int) -> FitConfig:
    """The settings that the variants change.

    Args:
        name: of the preset.
        steps: of each fit.
        crop: side of a step's image region, pixels; None takes the preset's for a fit with all of its steps, and at
            most `SHORT_CROP` for a shorter one.
        seed: of all random numbers.
    """
    whole = preset(name)
    usual = whole.crop if steps >= whole.steps else min(SHORT_CROP, whole.crop)
    return replace(whole, steps=steps, crop=usual if crop is None else crop, seed=seed)


def variants(base: FitConfig, positions: Path | None) -> dict[str, Variant]:
    """All variants by name; `positions` are the weights of a generator of positions, if there are any."""
    free = replace(base.schedule, widest_blur=0.0, release_until=0.0)
    geometry_alone = replace(base.weights, shape_from_image=0.0)
    strided = replace(base.model, unet=replace(base.model.unet, alias_free=False))
    uncorrected = replace(base.model, unet=replace(base.model.unet, corrects=False))
    mean = mean_start(base)
    at_once = replace(mean.schedule, widest_blur=0.0, release_until=0.0)
    configs = {
        "full": Variant(base),
        "no LMVS": Variant(hanging_start(base), stereo=False),
        "no coarse-to-fine, no root-to-tip": Variant(replace(base, schedule=free)),
        "geometry alone": Variant(replace(base, weights=geometry_alone)),
        "geometry alone, no streaks": Variant(replace(base, weights=replace(geometry_alone, streaks=0.0))),
        "positions": Variant(base, positions),
        "random networks": Variant(replace(base, networks="random")),
        "strided UNet": Variant(replace(base, model=strided, networks="random")),
        "no UNet": Variant(replace(base, model=uncorrected)),
        "no alpha loss": Variant(replace(base, weights=replace(base.weights, alpha=0.0))),
        "mean start": Variant(mean),
        "mean start, no coarse-to-fine, no root-to-tip": Variant(replace(mean, schedule=at_once)),
    }
    return {name: variant for name, variant in configs.items() if name != "positions" or positions is not None}


def hanging_start(base: FitConfig) -> FitConfig:
    """Without measured segments: no loss compares strands with segments, and no curls are looked for in them."""
    initial = replace(base.initial, curls=replace(base.initial.curls, find=False))
    return replace(base, weights=replace(base.weights, geometry=0.0), initial=initial)


def mean_start(base: FitConfig) -> FitConfig:
    """The paper's start: strands far from the segments, which see each other from farther away and learn faster."""
    schedule = ScheduleConfig(geometry_only=base.schedule.geometry_only)
    chamfer = replace(base.chamfer, radius=0.05, surface_radius=0.01)
    rates = replace(base.rates, shape=5 * base.rates.shape)
    return replace(base, initialise="mean", schedule=schedule, chamfer=chamfer, rates=rates)
