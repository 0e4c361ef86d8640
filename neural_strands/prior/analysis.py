"""Closed-form estimate of a strand's raw quantities: the part of the encoder that needs no training.

Given the curl's frequency and chirp, every amplitude enters the generator linearly, so the best amplitudes follow from
a linear least-squares solve. The frequency is searched over a grid and then refined together with the chirp by
Gauss-Newton steps that eliminate the amplitudes (variable projection, Golub and Pereyra 1973).

Errors are measured on positions and, weighted by `DIRECTION_WEIGHT`, on dp/dt; strands are first divided by their
length. Functions of t are rows: (strand, function, step).
"""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.bounded_quantities import logit_between, raw_from_length
from neural_strands.prior.generator import LARGEST_GAIN, Raw, StrandGenerator
from neural_strands.prior.heading import heading_from_smooth
from neural_strands.prior.synthesiser import Synthesiser

DIRECTION_WEIGHT = 0.03
"""Weight of an error in dp/dt against one in position, both in strand lengths."""
RIDGE = 2e-4
"""Cost of the curl's squared amplitudes. The slowest curls resemble the fastest smooth functions; without this cost,
large amplitudes of the two cancel each other and straight hair seems to curl."""
DAMPING = 1e-3
"""Regularisation of a Gauss-Newton step, relative to the mean diagonal of its normal equations."""
GRID = 48
"""Number of curl frequencies in the search grid."""
BLOCK = 256
"""Strands solved together, few enough for their sines to stay in the processor's cache."""
SMALLEST_SHARE, LARGEST_SHARE = 1e-4, 0.98
"""Bounds of the curl's amplitude as a share of `LARGEST_GAIN`; straight hair is at the lower bound."""


class Analysis:
    """The least-squares problem of one generator at one number of points, with its fixed parts computed once.

    Attributes:
        metric: maps functions of t to the space in which the plain squared norm is the error.
        project: `metric`, followed by a projection that removes what the smooth functions explain.
        smooth_weights: maps functions of t to the best weights of the smooth functions.
    """

    def __init__(self, generator: StrandGenerator, points: int) -> None:
        layer = generator.synthesiser
        self.layer, self.points = layer, points
        self.bounds = generator.frequency_bounds()
        self.modulated = layer.config.modulation == "all"
        t = layer.times(points)
        self.tau = t - 0.5
        self.metric = metric(layer, points)
        smooth = (layer.smooth_mix @ layer.carriers(t, points)) @ self.metric
        orthogonal, triangle = torch.linalg.qr(smooth.T)
        self.project = self.metric - (self.metric @ orthogonal) @ orthogonal.T
        self.smooth_weights = torch.linalg.solve_triangular(triangle, (self.metric @ orthogonal).T, upper=True).T
        self.warp = layer.warp_mix @ layer.carriers(t, None)
        low, high = self.bounds
        if self.modulated:
            self.grid = low * (high / low) ** torch.linspace(0.002, 0.998, GRID, device=t.device)
        else:
            self.grid = torch.full((1,), low, device=t.device)
        waves = self.angles(self.grid, torch.zeros(len(self.grid), len(self.warp), device=t.device)).sin()
        self.grid_bases = torch.linalg.qr((waves @ self.project).transpose(1, 2))[0]

    def angles(
        self, frequency: Float[Tensor, " strand"], warp: Float[Tensor, "strand warp"]
    ) -> Float[Tensor, "strand unit step"]:
        """Arguments of the second layer's sines at each step."""
        bent = (warp @ self.warp)[:, None] + self.layer.unit_phase[:, None]
        return self.layer.unit_frequencies(frequency)[..., None] * self.tau + bent

    def solve(
        self, shapes: Float[Tensor, "strand point 3"], refine: int
    ) -> tuple[Tensor, Tensor, Float[Tensor, "strand 3 unit"], Float[Tensor, "strand 3 smooth"]]:
        """Fit frequency, warp, curl amplitudes and smooth weights to strands of unit length."""
        gradient = self.layer.config.output == "gradient"
        steps = (segments(shapes) * (self.points - 1) if gradient else shapes).transpose(1, 2).contiguous()
        rest = steps @ self.project
        frequency = self.search(rest)
        warp = shapes.new_zeros(len(shapes), len(self.warp))
        basis, unit = self.amplitudes(rest, frequency, warp)
        for _ in range(refine if self.modulated else 0):
            moved = self.moved(rest - unit @ basis, basis, unit, frequency, warp)
            new_basis, new_unit = self.amplitudes(rest, *moved)
            better = squared(rest - new_unit @ new_basis) < squared(rest - unit @ basis)
            frequency = torch.where(better, moved[0], frequency)
            warp = torch.where(better[:, None], moved[1], warp)
            basis = torch.where(better[:, None, None], new_basis, basis)
            unit = torch.where(better[:, None, None], new_unit, unit)
        # `unit` weights sines that are already averaged over steps, whereas the synthesiser attenuates them itself.
        attenuation = self.layer.attenuation(self.layer.unit_frequencies(frequency), self.points)[:, None]
        smooth = (steps - unit @ self.angles(frequency, warp).sin()) @ self.smooth_weights
        return frequency, warp, unit / attenuation, smooth

    def search(self, rest: Float[Tensor, "strand 3 step"]) -> Float[Tensor, " strand"]:
        """The frequency in the grid whose sines explain most of the residual `rest`."""
        grid, step, unit = self.grid_bases.shape
        flat = self.grid_bases.permute(1, 0, 2).reshape(step, grid * unit)
        explained = (rest @ flat).square().sum(dim=1).unflatten(1, (grid, unit)).sum(dim=-1)
        return self.grid[explained.argmax(dim=1)]

    def amplitudes(
        self, rest: Float[Tensor, "strand 3 step"], frequency: Float[Tensor, " strand"], warp: Float[Tensor, "strand w"]
    ) -> tuple[Float[Tensor, "strand unit step"], Float[Tensor, "strand 3 unit"]]:
        """The curl's functions of t (projected) and their best amplitudes."""
        basis = self.angles(frequency, warp).sin() @ self.project
        return basis, solve_ridge(basis, rest)

    def moved(
        self,
        residual: Float[Tensor, "strand 3 step"],
        basis: Float[Tensor, "strand unit step"],
        unit: Float[Tensor, "strand 3 unit"],
        frequency: Float[Tensor, " strand"],
        warp: Float[Tensor, "strand warp"],
    ) -> tuple[Float[Tensor, " strand"], Float[Tensor, "strand warp"]]:
        """Frequency and warp after one Gauss-Newton step, with the amplitudes eliminated."""
        slope = unit @ self.angles(frequency, warp).cos()
        by_phase = torch.cat([self.tau[None], self.warp])
        columns = (slope[:, None] * by_phase[:, None]).flatten(1, 2) @ self.project
        columns = columns - solve_ridge(basis, columns) @ basis
        jacobian = columns.unflatten(1, (len(by_phase), 3)).flatten(2)
        size = jacobian.square().sum(dim=2).mean(dim=1)[:, None, None] + 1e-12
        step = solve_ridge(jacobian, residual.flatten(1)[:, None], DAMPING * size)[:, 0]
        low, high = self.bounds
        return (frequency + step[:, 0]).clamp(low * 1.001, high * 0.999), warp + step[:, 1:].clamp(-1.0, 1.0)


@torch.no_grad()
def analyse(generator: StrandGenerator, points: Float[Tensor, "strand point 3"], refine: int = 1) -> Raw:
    """Estimate the raw quantities of strands in local metres (at least three points, no zero lengths)."""
    length = lengths(points)
    problem = Analysis(generator, points.shape[1])
    solved = [problem.solve(block, refine) for block in (points / length[:, None, None]).split(BLOCK)]
    frequency, warp, unit, smooth = (torch.cat(parts) for parts in zip(*solved, strict=True))
    share = (unit.square().mean(dim=(1, 2)).sqrt() / LARGEST_GAIN).clamp(SMALLEST_SHARE, LARGEST_SHARE)
    return Raw(
        raw_from_length(length),
        torch.logit(share),
        logit_between(frequency, *problem.bounds),
        warp,
        unit / (LARGEST_GAIN * share)[:, None, None],
        heading_from_smooth(smooth, generator.synthesiser.reach()),
    )


def metric(layer: Synthesiser, points: int) -> Float[Tensor, "step step"]:
    """Square root of the error's quadratic form: |f @ metric|^2 = |positions|^2 + (weight x |slopes|)^2."""
    with torch.no_grad():
        steps = points - 1 if layer.config.output == "gradient" else points
        unit = torch.eye(steps, dtype=torch.float64, device=layer.carrier_frequency.device)
        return torch.linalg.qr(rows(layer, unit, points).T)[1].T.to(layer.carrier_frequency)


def rows(layer: Synthesiser, steps: Float[Tensor, "*batch step"], points: int) -> Float[Tensor, "*batch row"]:
    """Positions of functions of t, concatenated with their weighted slopes."""
    if layer.config.output == "position":
        placed, slope = steps[..., 1:] - steps[..., :1], torch.diff(steps, dim=-1) * (points - 1)
    else:
        placed, slope = steps.cumsum(dim=-1) / (points - 1), steps
    return torch.cat([placed, DIRECTION_WEIGHT * slope], dim=-1)


def squared(residual: Float[Tensor, "strand 3 step"]) -> Float[Tensor, " strand"]:
    """Squared norm of each strand's residual."""
    return residual.square().sum(dim=(1, 2))


def solve_ridge(
    basis: Float[Tensor, "strand unit step"],
    target: Float[Tensor, "strand row step"],
    ridge: float | Float[Tensor, "strand 1 1"] = RIDGE,
) -> Float[Tensor, "strand row unit"]:
    """Weights that minimise |target - weights @ basis|^2 + ridge |weights|^2, by normal equations."""
    normal = basis @ basis.transpose(1, 2)
    damped = normal + ridge * torch.eye(normal.shape[1], device=normal.device)
    return torch.linalg.solve(damped, basis @ target.transpose(1, 2)).transpose(1, 2)


@torch.no_grad()
def principal_functions(layer: Synthesiser, curves: Float[Tensor, "strand point 3"]) -> Float[Tensor, "smooth carrier"]:
    """Mixtures of the carriers that approximate the principal functions of t of the curves' coordinates.

    Every coordinate of every curve (divided by its length) is one function of t. The carriers are fitted to the
    functions that explain most of the positions and slopes.
    """
    config, count = layer.config, curves.shape[1]
    shapes = (curves / lengths(curves)[:, None, None]).double()
    steps = segments(shapes) * (count - 1) if config.output == "gradient" else shapes
    samples = rows(layer, steps.transpose(1, 2), count).flatten(0, 1)
    values, vectors = torch.linalg.eigh(samples.T @ samples / len(samples))
    functions = vectors.flip(1)[:, : config.smooth] * values.flip(0)[: config.smooth].clamp(min=0).sqrt()
    t = layer.times(count)
    basis = rows(layer, layer.carriers(t, count).double(), count)
    normal = basis @ basis.T
    damped = normal + 1e-8 * normal.diagonal().mean() * torch.eye(len(normal), dtype=normal.dtype, device=normal.device)
    return torch.linalg.solve(damped, basis @ functions).T.to(layer.smooth_mix)
