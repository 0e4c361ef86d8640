"""Fitting the appearance of strands that are given: texture Z_a, image generator, body and background colours.

The step is the appearance half of the end-to-end fit (paper, "Rendering Loss"); with the true strands it is a
benchmark of the renderer alone. Images are seen through crops about the hair: the same pixels, at less cost.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel, RenderOutput
from neural_strands.training.first_colours import initialise_colours
from neural_strands.training.observation import Observation, random_place

Perceptual = Callable[[Float[Tensor, "height width 3"], Float[Tensor, "height width 3"]], Float[Tensor, ""]]
"""Distance between a rendered and a photographed image, such as LPIPS."""


@dataclass(frozen=True)
class AppearanceConfig:
    """How appearance is fitted."""

    steps: int = 4000
    """Gradient steps, one crop each."""
    crop: int = 144
    """Side of a crop, pixels."""
    margin: int = 8
    """Pixels at a crop's border that carry no loss: there the image generator lacks its surroundings."""
    perceptual_weight: float = 0.04
    """Weight of the perceptual distance beside the mean squared error (lambda_L; the paper has 0.1 beside a sum)."""
    perceptual_from: float = 0.3
    """Share of the fit after which the perceptual distance counts: before it, it is dear and says little."""
    alpha_weight: float = 0.1
    """Weight of the mean squared error of the opacity, where masks are given."""
    texture_rate: float = 3e-3
    """Learning rate of Z_a."""
    surround_rate: float = 1e-3
    """Learning rate of the colours of body and background."""
    network_rate: float = 2e-3
    """Learning rate of the image generator."""
    largest_gradient: float = 0.05
    """Norm to which the gradient of the networks is cut: one odd crop must not undo the fit."""
    final_rate: float = 0.02
    """Learning rates at the last step, as a fraction of the first."""
    minutes: float = math.inf
    """Time limit: the learning rates fall with the time or with the steps, whichever is farther on."""
    warmup: int = 100
    """Steps over which the learning rates rise."""


def appearance_optimiser(model: HairModel, config: AppearanceConfig) -> torch.optim.Adam:
    """Adam over everything but the shape texture and the frozen generator."""
    return torch.optim.Adam(
        [
            {"params": [model.textures.appearance], "lr": config.texture_rate},
            {"params": [model.body.colour, model.background.colour], "lr": config.surround_rate},
            {"params": [*model.unet.parameters(), *model.shading.parameters()], "lr": config.network_rate},
        ],
        betas=(0.9, 0.99),
        eps=1e-10,
        fused=True,
    )


def appearance_loss(
    output: RenderOutput, target: Observation, config: AppearanceConfig, perceptual: Perceptual | None
) -> Float[Tensor, ""]:
    """Mean squared error, perceptual distance, and opacity against the mask, inside the crop's margin."""
    inner = without_margin(target, config.margin)
    image, photograph = output.rgb[inner], target.image[inner]
    loss = (image - photograph).square().mean()
    if perceptual is not None:
        loss = loss + config.perceptual_weight * perceptual(image, photograph)
    if target.mask is not None:
        loss = loss + config.alpha_weight * (output.alpha[inner] - target.mask[inner]).square().mean()
    return loss


def without_margin(target: Observation, margin: int) -> tuple[slice, slice]:
    """The part of a region that carries a loss: at its border the image generator lacks its surroundings."""
    height, width = target.image.shape[:2]
    edge = margin if min(height, width) > 4 * margin else 0
    return slice(edge, height - edge), slice(edge, width - edge)


def appearance_step(
    model: HairModel,
    strands: Strands,
    target: Observation,
    optimiser: torch.optim.Optimizer,
    config: AppearanceConfig,
    perceptual: Perceptual | None = None,
) -> float:
    """One gradient step on one (cropped) photograph; returns the loss before it."""
    optimiser.zero_grad(set_to_none=True)
    output = model.render(strands, target.camera, drawing=target.drawing)
    loss = appearance_loss(output, target, config, perceptual)
    loss.backward()
    networks = [*model.unet.parameters(), *model.shading.parameters()]
    torch.nn.utils.clip_grad_norm_(networks, config.largest_gradient)
    optimiser.step()
    return float(loss.detach())


def fit_appearance(
    model: HairModel,
    strands: Strands,
    targets: Sequence[Observation],
    config: AppearanceConfig,
    random: torch.Generator,
    perceptual: Perceptual | None = None,
) -> Iterator[float]:
    """Fit the appearance of fixed strands, yielding the loss of each step.

    Args:
        model: fitted in place.
        strands: world metres, with `root_uv`.
        targets: the photographs.
        config: steps and rates.
        random: draws views and crops.
        perceptual: distance beside the mean squared error; without one that term is left out.
    """
    begin = time.monotonic()
    targets = [replace(target, drawing=model.draw(strands, target.camera)) for target in targets]
    initialise_colours(model, strands, targets)
    optimiser = appearance_optimiser(model, config)
    first = [group["lr"] for group in optimiser.param_groups]
    order: list[int] = []
    for step in range(config.steps):
        progress = max(step / config.steps, (time.monotonic() - begin) / (60 * config.minutes))
        if progress >= 1:
            return
        factor = min(1.0, (step + 1) / config.warmup) * cosine(progress, config.final_rate)
        for group, rate in zip(optimiser.param_groups, first, strict=True):
            group["lr"] = rate * factor
        order = order or torch.randperm(len(targets), generator=random).tolist()
        whole = targets[order.pop()]
        marked = None if whole.mask is None else whole.mask > 0.5
        size = (whole.camera.height, whole.camera.width)
        target = whole.cropped(random_place(marked, size, config.crop, model.config.unet.stride, random))
        judge = perceptual if progress >= config.perceptual_from else None
        yield appearance_step(model, strands, target, optimiser, config, judge)


def cosine(progress: float, final: float) -> float:
    """Half a cosine from 1 down to `final`."""
    return final + (1 - final) * 0.5 * (1 + math.cos(math.pi * progress))
