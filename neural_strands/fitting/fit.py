"""The fit: images and segments in, scalp textures and renderer out (paper, "End-to-End Optimization").

Every random choice depends only on the seed, the step and the view's position in it, so a fit that is resumed, or split
between processes, makes the same choices as an uninterrupted one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn import Parameter

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.distributed import Workers
from neural_strands.fitting.first_colours import initialise_colours, initialise_hair_colours
from neural_strands.fitting.fit_data import FitData, random_region
from neural_strands.fitting.geometry_step import StepStrands, hold_unreleased, shape_losses
from neural_strands.fitting.losses import Perceptual, alpha_loss, rendering_loss
from neural_strands.fitting.photographs.regions import inner_part
from neural_strands.fitting.photographs.streak_loss import streak_loss
from neural_strands.fitting.photographs.surround_weights import surround_weights
from neural_strands.fitting.photographs.unreached import unreached_hair
from neural_strands.fitting.schedule import (
    appearance_begins,
    appearance_blur_width,
    blur_width,
    improves,
    rate_factor,
    released_points,
    settles,
)
from neural_strands.fitting.seen_points import front_segments, seen_points
from neural_strands.fitting.step_figures import StepFigures
from neural_strands.fitting.strand_width import estimate_width
from neural_strands.fitting.view_colours import improve_colours, initialise_view_colours
from neural_strands.foundation.devices.transfers import sent
from neural_strands.foundation.gradients import Adam
from neural_strands.foundation.interrupts import deferred_interrupt
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View
from neural_strands.model.hair_model import HairModel
from neural_strands.model.hair_volume import HairVolume, hair_volume
from neural_strands.model.networks import leave_colours

REFRESH_EVERY = 10
"""Number of shape steps after which all remembered strands are decoded again, not only those of the current step."""
LOOK_EVERY = 20
"""Number of shape steps after which the visibility of all points in the views is computed again."""


@dataclass
class FitState:
    """Progress and start of a fit: everything that a checkpoint stores.

    Attributes:
        model: textures, renderer and roots.
        optimiser: Adam over everything that is learned.
        remembered: all strands as last decoded, `step_points` each.
        drawn: all strands as rendered in image steps, `model.points` each.
        first: the initial strands, `step_points` each.
        seen: which of the remembered points were visible in some view when visibility was last computed.
        step: number of steps done.
        density: density of `drawn`; None until an image step needs it.
    """

    model: HairModel
    optimiser: torch.optim.Adam
    remembered: Float[Tensor, "root point 3"]
    drawn: Float[Tensor, "root drawn_point 3"]
    first: Float[Tensor, "root point 3"]
    seen: Bool[Tensor, "root point"]
    step: int = 0
    density: HairVolume | None = None

    def show(self, drawn: Float[Tensor, "root drawn_point 3"]) -> None:
        """Replace the strands that image steps render."""
        self.drawn, self.density = drawn, None

    def volume(self) -> HairVolume:
        """Density of the strands that image steps render."""
        if self.density is None:
            self.density = hair_volume(self.drawn)
        return self.density


def start_fit(model: HairModel, config: FitConfig) -> FitState:
    """Start at step 0 from a model whose shape texture holds the first strands."""
    rates = config.rates
    # The rate of what settles falls until strands do, the others until the last step.
    groups = [
        {"params": [model.textures.shape], "lr": rates.shape, "rate": rates.shape, "settles": True},
        {
            "params": [model.textures.appearance],
            "lr": rates.appearance,
            "rate": rates.appearance,
            "settled_rate": rates.settled_appearance,
        },
        {"params": networks(model), "lr": rates.network, "rate": rates.network},
        {"params": [model.body.colour], "lr": rates.surround, "rate": rates.surround},
        {"params": list(model.grain.parameters()), "lr": rates.grain, "rate": rates.grain},
    ]
    on_cpu = model.root_uv.device.type == "cpu"
    # Texels seen by only a few pixels have gradients far below Adam's usual epsilon. One pass over the memory is many
    # times as fast on the CPU; on CUDA it would move the step counters to the device (see `load_checkpoint`).
    optimiser = Adam(groups, betas=(0.9, 0.99), eps=1e-12, fused=on_cpu or None)
    with torch.no_grad():
        first = model.decode(config.step_points).points
        seen = torch.ones(first.shape[:2], dtype=torch.bool, device=first.device)
        return FitState(model, optimiser, first.clone(), model.decode().points, first, seen)


def fit(
    state: FitState,
    data: FitData,
    config: FitConfig,
    perceptual: Perceptual | None = None,
    workers: Workers | None = None,
    after_step: Callable[[FitState, dict[str, float]], None] | None = None,
    read_every: int = 1,
) -> None:
    """Run the remaining steps of a fit, in place.

    Args:
        state: the state to continue from; updated in place.
        data: views, segments and head.
        config: everything else.
        perceptual: LPIPS or its substitute; without it, the rendering loss is only the squared error.
        workers: the processes that share the views of a step.
        after_step: called with the state and the figures of each step, to log and to save.
        read_every: number of steps after which their figures are read, for which the host waits; `after_step` is then
            called for all of them, with the state after the last one.
    """
    workers = workers or Workers()
    figures = None if after_step is None else StepFigures(read_every)

    def tell() -> None:
        if figures is not None and after_step is not None:
            for row in figures.read():
                after_step(state, row)

    try:
        while state.step < config.steps:
            # A fit interrupted within a step would repeat part of it when resumed.
            with deferred_interrupt():
                _take_step(state, data, config, perceptual, workers, figures)
                if figures is not None and figures.due:
                    tell()
    finally:
        tell()


def _take_step(
    state: FitState,
    data: FitData,
    config: FitConfig,
    perceptual: Perceptual | None,
    workers: Workers,
    told: StepFigures | None,
) -> None:
    """Take one step and keep its figures."""
    learned = [parameter for group in state.optimiser.param_groups for parameter in group["params"]]
    images_from = appearance_begins(config.steps, config.schedule)
    step = state.step
    if told is not None:
        told.begin()
    settled_at, shape_every = _shape_schedule(state.model, config)
    for group in state.optimiser.param_groups:
        rate = group["rate"] if step < settled_at else group.get("settled_rate", group["rate"])
        group["lr"] = rate * rate_factor(step, settled_at if group.get("settles") else config.steps, config.schedule)
    state.optimiser.zero_grad(set_to_none=True)
    with_images = step >= images_from
    in_turn = shape_every > 0 and (step - images_from) % shape_every == 0
    shape_moves = (in_turn and step < settled_at) or not with_images
    figures: dict[str, Tensor] = {}
    if step == images_from:
        _first_colours(state, data, config)
    if step == settled_at:
        _settled_colours(state, data)
    if settled_at < config.steps and step == improves(config.steps, config.schedule):
        strands = Strands(state.drawn, root_uv=state.model.root_uv)
        improve_colours(state.model, strands, data.views)
    if shape_moves:
        figures |= _shape_part(state, data, config, workers)
    if with_images:
        judge = perceptual if step >= config.schedule.perceptual_from * config.steps else None
        figures |= _image_part(state, data, config, judge, workers, shape_moves)
    workers.sum_gradients(learned)
    # A single unusual crop must not undo the fit.
    torch.nn.utils.clip_grad_norm_(networks(state.model), config.largest_gradient)
    state.optimiser.step()
    state.step = step + 1
    if shape_moves and (with_images or step % REFRESH_EVERY == 0):
        _decode_all(state, config)
    if told is not None:
        told.add(state.step, figures)


def networks(model: HairModel) -> list[Parameter]:
    """Weights of the image generator and of the point shader."""
    return [*model.unet.parameters(), *model.shading.parameters()]


def step_generator(config: FitConfig, step: int, place: int) -> torch.Generator:
    """A generator for one part of one step, the same in every run and process."""
    return torch.Generator().manual_seed((config.seed * 1_000_003 + step) * 1_009 + place)


def _shape_schedule(model: HairModel, config: FitConfig) -> tuple[int, int]:
    """The step at which strands settle, and in how many steps the shape is updated once until then."""
    if len(model.textures.view) == 0:
        return config.steps, config.shape_every
    settled_at = settles(config.steps, config.schedule)
    often = max(1, round(config.shape_every * settled_at / config.steps))
    return settled_at, often if config.shape_every > 0 else 0


def _shape_steps(state: FitState, config: FitConfig) -> int:
    """Number of earlier steps that updated the shape, given that this one does."""
    images_from = appearance_begins(config.steps, config.schedule)
    _, shape_every = _shape_schedule(state.model, config)
    return state.step if state.step < images_from else images_from + (state.step - images_from) // shape_every


def _shape_part(state: FitState, data: FitData, config: FitConfig, workers: Workers) -> dict[str, Tensor]:
    """Back-propagate the geometric loss and head penalty of some strands.

    All processes compute the same, each with weight 1 / count.
    """
    model, device = state.model, state.remembered.device
    random = step_generator(config, state.step, 0)
    chosen = StepStrands.drawn(len(state.remembered), config.strands_per_step, random, device)
    targets = sent(torch.randint(len(data.segments), (config.targets_per_step,), generator=random), device)
    settled_at, _ = _shape_schedule(model, config)
    blur = blur_width(state.step, settled_at, config.schedule)
    released = released_points(state.step, settled_at, config.step_points, config.schedule) / config.step_points
    if _shape_steps(state, config) % LOOK_EVERY == 0:
        state.seen = seen_points(model, state.remembered, data.views.cameras)
    strands = hold_unreleased(model.decode(config.step_points, blur, chosen.index).points, released)
    losses = shape_losses(strands, chosen, state.remembered, state.first, state.seen, data, targets, config)
    weights = config.weights
    total = weights.geometry * (losses.surface + losses.coverage) + weights.head * losses.head
    if config.initialise == "flow":
        total = total + weights.first * losses.first + weights.hidden * losses.hidden
    figures = {name: getattr(losses, name).detach() for name in ("surface", "coverage", "head", "first", "hidden")}
    if data.streaks:
        streaks = _streak_part(state, data, strands, chosen.index, config, random)
        total, figures = total + weights.streaks * streaks, figures | {"streaks": streaks.detach()}
    (total / workers.count).backward()
    state.remembered[chosen.index] = strands.detach()
    return figures


def _streak_part(
    state: FitState,
    data: FitData,
    strands: Float[Tensor, "some point 3"],
    index: Int64[Tensor, " some"],
    config: FitConfig,
    random: torch.Generator,
) -> Float[Tensor, ""]:
    """Compare the decoded strands with the streaks of some views, as far as these see them."""
    chosen = torch.randperm(len(data.streaks), generator=random)[: config.streaks.views].tolist()
    views = [data.streaks[view] for view in chosen]
    fronts = [front_segments(state.model, state.remembered, view.camera, view.body_depth()) for view in views]
    row = index.new_full((len(state.remembered),), -1)
    row[index] = torch.arange(len(index), device=index.device)
    return streak_loss(strands, row, views, fronts, config.streaks.pixels, random)


def _image_part(
    state: FitState,
    data: FitData,
    config: FitConfig,
    perceptual: Perceptual | None,
    workers: Workers,
    shape_moves: bool,
) -> dict[str, Tensor]:
    """Back-propagate the rendering and alpha losses of this process's share of the step's regions."""
    model, weights = state.model, config.weights
    nothing = torch.zeros((), device=state.drawn.device)
    sums = {"render": nothing, "perceptual": nothing, "alpha": nothing}
    for place in workers.share(config.views_per_step):
        random = step_generator(config, state.step, 1 + place)
        view = int(torch.randint(len(data.views), (1,), generator=random))
        target, trimap = random_region(data, view, config.crop, model.config.unet.stride, config.trimap, random)
        points = state.drawn
        if shape_moves and weights.shape_from_image > 0:
            points = _with_gradient(state, target, config)
        strands = Strands(points, root_uv=model.root_uv)
        blur = appearance_blur_width(state.step, config.steps, config.schedule)
        surround = surround_weights(target)
        body_weight = None if surround is None else surround.body
        output = model.render(strands, target.camera, blur, state.volume(), body_weight, photographed=True)
        height, width = trimap.alpha.shape
        inner = inner_part((height, width), config.margin).of
        unreached = unreached_hair(trimap.alpha, output.coverage)
        photograph = torch.where(unreached[..., None], output.rgb.detach(), target.image)
        image, photograph, certain = inner(output.rgb), inner(photograph), inner(trimap.supervised & ~unreached)
        parts = {
            "render": weights.render * rendering_loss(image, photograph),
            "alpha": weights.alpha * alpha_loss(inner(output.alpha), inner(trimap.alpha), certain),
        }
        if perceptual is not None:
            # Without grain, the generator would have to imitate the photographs' noise.
            grainy = inner(model.with_grain(output, random).rgb)
            parts["perceptual"] = weights.render * weights.perceptual * perceptual(grainy, photograph)
        (sum(parts.values(), torch.zeros((), device=points.device)) / config.views_per_step).backward()
        for name, value in parts.items():
            sums[name] = sums[name] + value.detach() / config.views_per_step
    return sums


def _with_gradient(state: FitState, target: View, config: FitConfig) -> Float[Tensor, "root point 3"]:
    """All strands; those visible in the view are decoded with a (scaled) gradient into the shape texture."""
    model = state.model
    seen = front_segments(model, state.drawn, target.camera)
    strands = len(state.drawn)
    strand = torch.where(seen >= 0, seen // (state.drawn.shape[1] - 1), strands)
    flags = torch.zeros(strands + 1, dtype=torch.bool, device=seen.device).index_fill_(0, strand.view(-1), True)
    index = flags[:-1].nonzero().squeeze(1)
    if len(index) == 0:
        return state.drawn
    decoded = model.decode(state.drawn.shape[1], index=index).points
    scaled = decoded.detach() + config.weights.shape_from_image * (decoded - decoded.detach())
    return state.drawn.index_copy(0, index, scaled)


def _first_colours(state: FitState, data: FitData, config: FitConfig) -> None:
    """Before the first image step, estimate the strands' width and initialise all colours in closed form."""
    if config.shape_every > 0:
        _decode_all(state, config)
    strands = Strands(state.drawn, root_uv=state.model.root_uv)
    if config.trimap.mattes:
        state.model.strand_width = estimate_width(state.model, strands, data.views)
    initialise_colours(state.model, strands, data.views)


def _settled_colours(state: FitState, data: FitData) -> None:
    """Once strands keep their shape, find the colours of all places on them in closed form, and learn on from there."""
    strands = Strands(state.drawn, root_uv=state.model.root_uv)
    leave_colours(state.model)
    torch.nn.init.zeros_(state.model.textures.appearance)
    initialise_hair_colours(state.model, strands, data.views)
    initialise_view_colours(state.model, strands, data.views)


@torch.no_grad()
def _decode_all(state: FitState, config: FitConfig) -> None:
    """Decode all strands again after the shape has changed, for images and for the geometric loss."""
    state.show(state.model.decode().points)
    pick = torch.linspace(0, state.drawn.shape[1] - 1, config.step_points).round().long()
    state.remembered = state.drawn[:, sent(pick, state.drawn.device)].contiguous()
