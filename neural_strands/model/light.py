"""Light that reaches hair and skin through the hair, and how it changes when hair is edited.

The colours that a fit learns include the shadows of the fitted hair. Edited hair casts different ones, so linear
colours are multiplied by the ratio of the light that reaches a place now to the light that reached it then. Light comes
evenly from all directions. It loses a share at every fibre that it crosses, as in the dual scattering of Zinke et al.
2008, and the head blocks it.

Skin beneath hair is a special case: photographs do not show it. Once hair no longer covers it, it takes the colour of
the skin around it, in the light that reaches it now (`model.surround.hidden_skin`).
"""

import itertools
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from scipy.spatial import KDTree
from torch import Tensor

from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.geometry.resample import interpolate_evenly
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.model.hair_volume import HairVolume
from neural_strands.model.surround.body import SkinChange
from neural_strands.model.surround.hidden_skin import extend_over_mesh, known_share

LOST = 0.3
"""Share of the light lost at each fibre; the rest is scattered forwards."""
AMBIENT = 0.1
"""Scattered light that reaches every place, as a share of the light in the open."""
BRIGHTEST = 2.0
"""Largest factor applied to a colour: a fit knows too little about what lay in deep shadow for a larger one."""
FAINTEST = 1e-3
"""Smallest divisor for the share of directions in which the head does not block the view."""
KNOTS = 12
"""Number of places along a strand at which light is computed."""
FADE = 0.03
"""Distance from the border of the fitted hair's grid over which changes of the skin's light fade in, metres: near the
border, light enters that a larger grid may find blocked."""
ABOVE = 0.004
"""Height above the skin at which the light on it is computed, metres."""


@dataclass(frozen=True)
class LightField:
    """Share of the surrounding light that reaches each node of a grid.

    Attributes:
        grid: the grid of the hair's density.
        values: the shares, from 0 to 1.
    """

    grid: VoxelGrid
    values: Float[Tensor, "x y z 1"]

    @classmethod
    @torch.no_grad()
    def through(
        cls, volume: HairVolume, width: float, surface: Float[Tensor, "place 3"], lost: float = LOST
    ) -> "LightField":
        """Compute the light that passes through hair and around the body.

        Args:
            volume: density of the hair.
            width: of the strands, metres.
            surface: points on head and body (`surface_samples`).
            lost: share of the light lost at each fibre: 1 counts only free lines of sight, 0 ignores the hair.
        """
        extinction = lost * width * volume.density()
        return cls(
            volume.grid, transmitted(extinction, solid_voxels(volume.grid, surface), volume.grid.spacing)[..., None]
        )

    def at(self, places: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Light at places, `AMBIENT` included; places outside the grid take the value of the nearest node."""
        return AMBIENT + (1 - AMBIENT) * self.direct(places)

    def direct(self, places: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Light at places, without `AMBIENT`."""
        sampled = self.grid.sample(self.values, places.reshape(-1, 3), outside="border")
        return sampled[:, 0].reshape(places.shape[:-1])


def transmitted(
    extinction: Float[Tensor, "x y z"], solid: Float[Tensor, "x y z"], spacing: float
) -> Float[Tensor, "x y z"]:
    """Light that reaches each node, averaged over the 26 directions of a cube's faces, edges and corners.

    Light is followed from node to node: what reaches a node is what reached the previous one, less the loss between
    them.

    Args:
        extinction: share of the light that is lost per metre.
        solid: 1 where no light passes, else 0.
        spacing: distance between nodes, metres.
    """
    total, weights = torch.zeros_like(extinction), 0.0
    for axis, sign in itertools.product(range(3), (1, -1)):
        turned = [values.movedim(axis, 0).contiguous() for values in (extinction, solid)]
        if sign < 0:
            turned = [values.flip(0) for values in turned]
        # Each direction is swept only once, along the first axis on which it advances.
        across = [(0,) if other < axis else (-1, 0, 1) for other in range(3) if other != axis]
        light, weight = _swept(turned[0], turned[1], spacing, list(itertools.product(*across)))
        total += (light.flip(0) if sign < 0 else light).movedim(0, axis)
        weights += weight
    return total / weights


def _swept(
    extinction: Float[Tensor, "x y z"],
    solid: Float[Tensor, "x y z"],
    spacing: float,
    shifts: list[tuple[int, ...]],
) -> tuple[Float[Tensor, "x y z"], float]:
    """Weighted sum of the light along directions of increasing x, and the sum of the weights.

    Args:
        extinction: share of the light that is lost per metre.
        solid: 1 where no light passes, else 0.
        spacing: distance between nodes, metres.
        shifts: nodes by which each direction advances along y and z per step along x.
    """
    axes = torch.tensor([1 + abs(y) + abs(z) for y, z in shifts], device=extinction.device)
    # Solid angle of a cube's faces by the trapezoidal rule; an edge belongs to two faces, a corner to three.
    weight = axes * 0.5 ** (axes - 1) * axes**-1.5
    lengths = torch.arange(1, int(axes.max()) + 1, device=axes.device).sqrt()
    half = torch.exp(-0.5 * spacing * lengths[:, None, None, None] * extinction)
    depth, rows, columns = extinction.shape
    light = extinction.new_ones(len(shifts), rows + 2, columns + 2)
    sums = torch.zeros_like(half[0])
    open_ = 1 - solid
    for x in range(depth):
        passed = half[axes - 1, x]
        here = torch.stack([light[k, 1 - y : 1 - y + rows, 1 - z : 1 - z + columns] for k, (y, z) in enumerate(shifts)])
        here *= passed
        torch.mv(here.view(len(shifts), -1).T, weight, out=sums[x].view(-1))
        light[:, 1:-1, 1:-1] = here.mul_(passed).mul_(open_[x])
    return sums, float(weight.sum())


def surface_samples(body: Mesh, spacing: float) -> Float[Tensor, "place 3"]:
    """Sample a surface so densely that every voxel it passes through gets a point.

    Args:
        body: the surface; may have no faces.
        spacing: edge of the voxels, metres.
    """
    corners = body.corners()
    longest = (corners - corners.roll(1, dims=1)).norm(dim=-1).amax(dim=1)
    halvings = (longest / spacing).clamp(min=1.0).log2().ceil().long()
    places = [corners[:, 0]]
    for halved in halvings.unique().tolist():
        a, b, c = corners[halvings == halved].unbind(dim=1)
        steps = 2**halved
        shares = [(i / steps, j / steps) for i in range(steps + 1) for j in range(steps + 1 - i)]
        places += [(1 - first - second) * a + first * b + second * c for first, second in shares]
    return torch.cat(places)


def solid_voxels(grid: VoxelGrid, surface: Float[Tensor, "place 3"]) -> Float[Tensor, "x y z"]:
    """1 in voxels that contain a point of the surface, else 0."""
    solid = torch.zeros(grid.count, device=surface.device)
    index, inside = grid.index(surface)
    solid[index[inside]] = 1.0
    return solid.view(grid.shape)


@dataclass(frozen=True)
class LightChange:
    """Change of linear colours between the fitted and the edited hair.

    Attributes:
        strands: factors at knots evenly spaced along the points of every strand.
        skin: change of the body's colours.
    """

    strands: Float[Tensor, "strand knot 1"]
    skin: SkinChange


@dataclass(frozen=True)
class BakedLight:
    """The light in which an appearance was fitted.

    Attributes:
        uv: roots of the fitted strands on the scalp chart.
        strands: light at knots evenly spaced along t.
        skin: light just above the vertices of the body, at `skin_places`.
        skin_places: those places, in world metres.
        near: how far they lie inside the grid of the hair's density: 0 outside and at its border, 1 beyond `FADE`.
        known: how well photographs determine the skin's colour there, from 0 to 1.
        bare: linear colours of the skin in full light, extended to where they are not known.
        surface: points on head and body.
        width: of the strands, metres.
    """

    uv: Float[Tensor, "strand 2"]
    strands: Float[Tensor, "strand knot"]
    skin: Float[Tensor, " vertex"]
    skin_places: Float[Tensor, "vertex 3"]
    near: Float[Tensor, " vertex"]
    known: Float[Tensor, " vertex"]
    bare: Float[Tensor, "vertex 3"]
    surface: Float[Tensor, "place 3"]
    width: float

    @classmethod
    @torch.no_grad()
    def of(
        cls, strands: Strands, volume: HairVolume, width: float, body: Mesh, skin: Float[Tensor, "vertex 3"]
    ) -> "BakedLight":
        """Compute the light on strands as they were fitted, and on the skin beneath.

        Args:
            strands: the fitted strands, with `root_uv`.
            volume: their density.
            width: of the strands, metres.
            body: head and body.
            skin: fitted linear colours at its vertices.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        surface = surface_samples(body, volume.grid.spacing)
        field = LightField.through(volume, width, surface)
        places = body.vertices + ABOVE * vertex_normals(body) if len(body.faces) else body.vertices
        near, light = (volume.grid.depth(places) / FADE).clamp(0.0, 1.0), field.at(places)
        sight, unhindered = (LightField.through(volume, width, surface, lost).direct(places) for lost in (1.0, 0.0))
        known = torch.where(near > 0, known_share(sight / unhindered.clamp(min=FAINTEST)), 1.0)
        bare = extend_over_mesh(skin / light[:, None], known, body)
        along = field.at(interpolate_evenly(strands.points, KNOTS))
        return cls(strands.chart_positions(), along, light, places, near, known, bare, surface, width)

    @torch.no_grad()
    def changed(self, strands: Strands, volume: HairVolume) -> LightChange:
        """Compare the light on edited strands, and on the skin beneath, with the light in which they were fitted.

        Args:
            strands: the edited strands, with `root_uv`.
            volume: their density.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        field = LightField.through(volume, self.width, self.surface)
        along = interpolate_evenly(strands.parameters(), KNOTS)
        before = _between(self.strands[self._fitted_on(strands.chart_positions())], along)
        factor = field.at(interpolate_evenly(strands.points, KNOTS)) / before
        now = field.at(self.skin_places)
        # Beyond the grid of the fitted hair, its shadows are unknown.
        skin = torch.lerp(torch.ones_like(now), (now / self.skin).clamp(max=BRIGHTEST), self.near)
        change = SkinChange(skin, now[:, None] * self.bare, 1 - self.known)
        return LightChange(factor[..., None].clamp(max=BRIGHTEST), change)

    def _fitted_on(self, uv: Float[Tensor, "strand 2"]) -> Int64[Tensor, " strand"]:
        """Index of the fitted strand whose root is nearest on the chart."""
        if uv.shape == self.uv.shape and torch.equal(uv, self.uv):
            return torch.arange(len(uv), device=uv.device)
        return torch.from_numpy(KDTree(self.uv.cpu().numpy()).query(uv.cpu().numpy())[1]).to(uv.device)


def _between(
    values: Float[Tensor, "strand knot"], along: Float[Tensor, "strand place"]
) -> Float[Tensor, "strand place"]:
    """Interpolate values at knots to positions along the strands, in [0, 1]."""
    place = along * (values.shape[1] - 1)
    before = place.long().clamp(0, values.shape[1] - 2)
    return torch.lerp(values.gather(1, before), values.gather(1, before + 1), place - before)
