"""Closed-form estimate of a strand's raw quantities: the part of the encoder that needs no training.

Given the curl's frequency and chirp, every amplitude enters the generator linearly, so the best ones are a linear least
squares solve. The frequency is searched over a grid, then refined with the chirp by Gauss-Newton steps in which the
amplitudes are solved for at once (variable projection, Golub and Pereyra 1973).

Errors are measured on positions and, weighted by `DIRECTION_WEIGHT`, on dp/dt; strands are first divided by their
length. "Rows" below are those two kinds of equations, one after the other.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.generator import (
    LARGEST_GAIN,
    LONGEST,
    SHORTEST,
    Raw,
    StrandGenerator,
    logit_between,
)
from neural_strands.prior.synthesiser import Synthesiser, times

DIRECTION_WEIGHT = 0.03
"""Weight of an error in dp/dt against one in position, both in strand lengths."""
RIDGE = 1e-5
"""Regularisation of the amplitudes, relative to the mean diagonal of their normal equations."""
GRID = 48
"""Curl frequencies that are tried."""


class Analysis:
    """The least squares problem of one generator at one number of points, its fixed parts worked out once."""

    def __init__(self, generator: StrandGenerator, points: int) -> None:
        synthesiser = generator.synthesiser
        self.synthesiser, self.points = synthesiser, points
        self.bounds = generator.frequency_bounds()
        self.modulated = synthesiser.config.modulation == "all"
        t = times(points, synthesiser.config.output, synthesiser.carrier_frequency)
        self.tau = t - 0.5
        self.smooth = self.rows((synthesiser.smooth_mix @ synthesiser.carriers(t, points)).T)
        self.orthogonal, self.triangle = torch.linalg.qr(self.smooth)
        self.warp = (synthesiser.warp_mix @ synthesiser.carriers(t, None)).T
        if self.modulated:
            low, high = self.bounds
            self.grid = low * (high / low) ** torch.linspace(0.002, 0.998, GRID, device=t.device)
        else:
            self.grid = torch.full((1,), self.bounds[0], device=t.device)
            self.fixed = generator.fixed_frequencies()
        bases = self.curl_rows(self.grid, None)
        self.grid_bases = torch.linalg.qr(bases - self.orthogonal @ (self.orthogonal.T @ bases))[0]

    def rows(self, steps: Float[Tensor, "*batch step column"]) -> Float[Tensor, "*batch row column"]:
        """Equations of functions of t: their integral from the root, and (weighted) their values."""
        if self.synthesiser.config.output == "position":
            placed = steps[..., 1:, :] - steps[..., :1, :]
            gradient = (steps[..., 1:, :] - steps[..., :-1, :]) * (self.points - 1)
        else:
            placed, gradient = steps.cumsum(dim=-2) / (self.points - 1), steps
        return torch.cat([placed, DIRECTION_WEIGHT * gradient], dim=-2)

    def curl_waves(
        self, frequency: Float[Tensor, " strand"], warp: Float[Tensor, "strand warp"] | None
    ) -> Float[Tensor, "strand step unit"]:
        """The second layer's sines at one frequency a strand."""
        layer = self.synthesiser
        each = frequency[:, None] + layer.unit_frequency if self.modulated else self.fixed.expand(len(frequency), -1)
        angle = each[:, None] * self.tau[:, None] + layer.unit_phase
        if warp is not None:
            angle = angle + (warp @ self.warp.T)[..., None]
        return angle.sin() * layer.attenuation(each, self.points)[:, None]

    def curl_rows(
        self, frequency: Float[Tensor, " strand"], warp: Float[Tensor, "strand warp"] | None
    ) -> Float[Tensor, "strand row unit"]:
        """Equations of the second layer's sines."""
        return self.rows(self.curl_waves(frequency, warp))

    def project(self, rows: Float[Tensor, "*batch row column"]) -> Float[Tensor, "*batch row column"]:
        """Take out what the smooth functions explain."""
        return rows - self.orthogonal @ (self.orthogonal.T @ rows)

    def solve(self, shapes: Float[Tensor, "strand point 3"], refine: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Frequency, warp, curl amplitudes (unit, 3) and smooth weights (smooth, 3) of strands of unit length."""
        offsets = segments(shapes)
        target = torch.cat([shapes[:, 1:] - shapes[:, :1], DIRECTION_WEIGHT * (self.points - 1) * offsets], dim=1)
        rest = self.project(target)
        warp = shapes.new_zeros(len(shapes), self.warp.shape[1])
        frequency = self.search(rest)
        for _ in range(refine if self.modulated else 0):
            frequency, warp = self.refined(rest, frequency, warp)
        basis = self.curl_rows(frequency, warp)
        unit = solve_ridge(self.project(basis), rest)
        left = self.orthogonal.T @ (target - basis @ unit)
        smooth = torch.linalg.solve_triangular(self.triangle, left, upper=True)
        return frequency, warp, unit, smooth

    def search(self, rest: Float[Tensor, "strand row 3"]) -> Float[Tensor, " strand"]:
        """The grid's frequency whose sines explain most of the rest."""
        grid, row, unit = self.grid_bases.shape
        flat = self.grid_bases.permute(1, 0, 2).reshape(row, grid * unit)
        explained = (rest.transpose(1, 2) @ flat).square().sum(dim=1).unflatten(1, (grid, unit)).sum(dim=-1)
        return self.grid[explained.argmax(dim=1)]

    def refined(
        self, rest: Float[Tensor, "strand row 3"], frequency: Float[Tensor, " strand"], warp: Float[Tensor, "strand w"]
    ) -> tuple[Float[Tensor, " strand"], Float[Tensor, "strand w"]]:
        """One damped Gauss-Newton step of frequency and warp, kept where it lowers the error."""
        layer = self.synthesiser
        waves = self.curl_waves(frequency, warp)
        basis = self.project(self.rows(waves))
        unit = solve_ridge(basis, rest)
        residual = rest - basis @ unit
        # d sin(angle) / d angle is the sine a quarter turn on.
        each = frequency[:, None] + layer.unit_frequency
        angle = each[:, None] * self.tau[:, None] + layer.unit_phase + (warp @ self.warp.T)[..., None]
        slope = (angle.cos() * layer.attenuation(each, self.points)[:, None]) @ unit
        by_phase = torch.cat([self.tau[:, None], self.warp], dim=1)
        count = by_phase.shape[1]
        columns = (slope[..., None] * by_phase[:, None]).flatten(2)
        columns = self.project(self.rows(columns))
        columns = columns - basis @ solve_ridge(basis, columns)
        jacobian = columns.unflatten(2, (3, count)).flatten(1, 2)
        step = solve_ridge(jacobian, residual.flatten(1)[..., None], 1e-3)[..., 0]
        low, high = self.bounds
        moved = (frequency + step[:, 0]).clamp(low * 1.001, high * 0.999), warp + step[:, 1:].clamp(-1.0, 1.0)
        basis = self.project(self.curl_rows(*moved))
        after = (rest - basis @ solve_ridge(basis, rest)).square().sum(dim=(1, 2))
        better = after < residual.square().sum(dim=(1, 2))
        return torch.where(better, moved[0], frequency), torch.where(better[:, None], moved[1], warp)


def solve_ridge(
    basis: Float[Tensor, "strand row unit"], target: Float[Tensor, "strand row column"], ridge: float = RIDGE
) -> Float[Tensor, "strand unit column"]:
    """Least squares by regularised normal equations."""
    normal = basis.transpose(1, 2) @ basis
    scale = normal.diagonal(dim1=1, dim2=2).mean(dim=1)[:, None, None] + 1e-12
    damped = normal + ridge * scale * torch.eye(normal.shape[1], device=normal.device)
    return torch.linalg.solve(damped, basis.transpose(1, 2) @ target)


def analyse(generator: StrandGenerator, points: Float[Tensor, "strand point 3"], refine: int = 2) -> Raw:
    """Raw quantities of strands in local metres (at least two points, none of zero length)."""
    length = lengths(points)
    problem = Analysis(generator, points.shape[1])
    frequency, warp, unit, smooth = problem.solve(points / length[:, None, None], refine)
    size = unit.square().mean(dim=(1, 2)).sqrt()
    share = (size / LARGEST_GAIN).clamp(1e-4, 0.98)
    gain = LARGEST_GAIN * share
    return Raw(
        logit_between(length, SHORTEST, LONGEST),
        torch.logit(share),
        logit_between(frequency, *problem.bounds),
        warp,
        (unit / gain[:, None, None]).transpose(1, 2),
        smooth.transpose(1, 2),
    )


def fit_smooth_functions(synthesiser: Synthesiser, curves: Float[Tensor, "strand point 3"]) -> Tensor:
    """Mixes of the carriers that follow the principal functions of t of the curves' coordinates.

    Every coordinate of every curve (divided by its length) is one function of t; the functions that explain most of
    their positions and slopes are fitted by the carriers.
    """
    config, count = synthesiser.config, curves.shape[1]
    shapes = curves / lengths(curves)[:, None, None]
    slope = segments(shapes) * (count - 1)
    rows = torch.cat([shapes[:, 1:] - shapes[:, :1], DIRECTION_WEIGHT * slope], dim=1)
    samples = rows.transpose(1, 2).flatten(0, 1).double()
    values, vectors = torch.linalg.eigh(samples.T @ samples)
    functions = vectors.flip(1)[:, : config.smooth] * values.flip(0)[: config.smooth].div(len(samples)).sqrt()
    t = times(count, config.output, synthesiser.carrier_frequency)
    waves = synthesiser.carriers(t, count).T.double()
    placed = waves[1:] - waves[:1] if config.output == "position" else waves.cumsum(dim=0) / (count - 1)
    difference = torch.diff(waves, dim=0) * (count - 1) if config.output == "position" else waves
    basis = torch.cat([placed, DIRECTION_WEIGHT * difference])
    normal = basis.T @ basis
    damped = normal + 1e-8 * normal.diagonal().mean() * torch.eye(len(normal), dtype=normal.dtype)
    mix = torch.linalg.solve(damped, basis.T @ functions).T
    explained = 1 - (functions - basis @ mix.T).square().sum(0) / functions.square().sum(0)
    if explained.min() < 1 - 1 / math.e:
        raise ValueError(f"the carriers explain only {float(explained.min()):.2f} of a smooth function; use more")
    return mix.float()
