"""The background: a shell around the subject, whose distance and colour depend on the direction.

A room is such a shell if the subject sees all of its walls. On a sphere of a single radius, photographs from different
sides would disagree about what lies where, and their mean would be blurred. Both are equirectangular pictures: u
follows the azimuth, v the elevation, y up.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from neural_strands.geometry.cameras import Camera
from neural_strands.model.surround.body import START, SurroundConfig
from neural_strands.raster.texture import blur_texture, sample_picture

STEPS = 8
"""Steps by which the place is found where a ray leaves the shell."""
SPARSE, FEWEST = 8, 16
"""Pixels between the rays of a picture whose lengths are computed, along each axis, and the least number of such rays;
other lengths are interpolated."""
ENDLESS = 1e6
"""Length of rays that miss the shell, metres."""


class Background(nn.Module):
    """A shell around the subject, seen from inside; both of its pictures are `wrapped`.

    Attributes:
        nearness: inverse distance of the shell from its centre, 1/metres.
        colour: of the shell, linear.
    """

    centre: Tensor
    nearness: Tensor
    colour: Tensor

    def __init__(self, centre: Float[Tensor, "3"], config: SurroundConfig) -> None:
        super().__init__()
        self.register_buffer("centre", centre.float().clone())
        self._centre_on_cpu: tuple[tuple[int, int], Tensor] | None = None
        for name, channels, rows, start in (
            ("nearness", 1, config.background_directions, 1 / config.background_distance),
            ("colour", 3, config.background_texture, START),
        ):
            self.register_buffer(name, torch.full((channels, rows, 2 * rows + 2), start))

    @property
    def centre_on_cpu(self) -> Float[Tensor, "3"]:
        """A copy of the centre on the CPU, made anew (a device synchronisation) only after the centre has changed."""
        if self.centre.is_inference():
            # Inference tensors have no version counter, so a change could not be noticed.
            return self.centre.cpu()
        state = (id(self.centre), self.centre._version)
        if self._centre_on_cpu is None or self._centre_on_cpu[0] != state:
            self._centre_on_cpu = (state, self.centre.cpu())
        return self._centre_on_cpu[1]

    def forward(self, camera: Camera) -> Float[Tensor, "height width 3"]:
        """Linear colour of the background behind every pixel."""
        return sample_around(self.colour, self.directions(camera)).permute(1, 2, 0)

    def directions(self, camera: Camera) -> Float[Tensor, "3 height width"]:
        """Unit directions from the centre to what each pixel shows of the shell."""
        still = camera.in_room()
        rays, origin = still.ray_planes(), still.position - self.centre
        lengths = shell_distances(origin, rays, self.nearness)
        return _unit(origin[:, None, None] + lengths * rays)


def shell_distances(
    origin: Float[Tensor, "3"], rays: Float[Tensor, "3 height width"], nearness: Float[Tensor, "1 rows wrapped"]
) -> Float[Tensor, "height width"]:
    """Lengths of rays until they leave a shell for good, metres; `ENDLESS` for those that miss it.

    Args:
        origin: start of the rays relative to the centre of the shell, metres.
        rays: unit directions, of the pixels of a picture.
        nearness: inverse distances of the shell; see `Background`.
    """
    size = [min(length, max(FEWEST, math.ceil(length / SPARSE) + 1)) for length in rays.shape[1:]]
    return _resized(followed_rays(origin, _unit(_resized(rays, size)), nearness)[None], rays.shape[1:])[0]


def followed_rays(
    origin: Float[Tensor, "3"], rays: Float[Tensor, "3 height width"], nearness: Float[Tensor, "1 rows wrapped"]
) -> Float[Tensor, "height width"]:
    """`shell_distances` of rays that need not be those of a picture: each of them is followed."""
    near = nearness.mean().expand(*rays.shape[1:])
    for step in range(STEPS):
        there = sample_around(nearness, sphere_directions(origin, rays, 1 / near))[0]
        # The first step is from far off; later ones could otherwise jump back and forth.
        near = there if step == 0 else 0.5 * (near + there)
    return sphere_distances(origin, rays, 1 / near)


def sphere_directions(
    origin: Float[Tensor, "3"],
    rays: Float[Tensor, "3 height width"],
    radius: float | Float[Tensor, "height width"],
) -> Float[Tensor, "3 height width"]:
    """Unit directions from a sphere's centre to where rays leave it; a ray that misses it keeps its own direction."""
    return _unit(origin[:, None, None] + sphere_distances(origin, rays, radius) * rays)


def sphere_distances(
    origin: Float[Tensor, "3"],
    rays: Float[Tensor, "3 height width"],
    radius: float | Float[Tensor, "height width"],
) -> Float[Tensor, "height width"]:
    """Lengths of rays until they leave a sphere; `ENDLESS` for those that miss it.

    Args:
        origin: start of the rays relative to the sphere's centre, metres.
        rays: unit directions of the rays, axes first.
        radius: of the sphere of each ray, metres.
    """
    along = (origin[:, None, None] * rays).sum(dim=0)
    discriminant = along.square() - origin @ origin + radius**2
    distance = discriminant.clamp(min=0).sqrt() - along
    return torch.where((discriminant > 0) & (distance > 0), distance, ENDLESS)


def equirectangular(
    directions: Float[Tensor, "3 height width"],
) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
    """Texture coordinates u and v in [0, 1] of unit directions.

    u is the azimuth: 0.5 at +z, growing towards +x. v is the elevation: 0 straight down, 1 straight up.
    """
    x, y, z = directions
    return torch.atan2(x, z) / (2 * math.pi) + 0.5, torch.asin(y.clamp(-1, 1)) / math.pi + 0.5


def sample_around(
    picture: Float[Tensor, "channel rows wrapped"], directions: Float[Tensor, "3 height width"]
) -> Float[Tensor, "channel height width"]:
    """Interpolate a picture in all directions, with a repeated column on either side (`wrapped`)."""
    return sample_wrapped(picture, *equirectangular(directions))


def sample_wrapped(
    picture: Float[Tensor, "channel rows wrapped"], u: Float[Tensor, "height width"], v: Float[Tensor, "height width"]
) -> Float[Tensor, "channel height width"]:
    """The same at texture coordinates; see `equirectangular`."""
    columns = picture.shape[2]
    uv = torch.stack([(u * (columns - 2) + 1) / columns, v], dim=-1)
    read = sample_picture(picture.permute(1, 2, 0), uv.view(-1, 2))
    return read.T.reshape(len(picture), *u.shape)


def wrapped(picture: Float[Tensor, "channel rows columns"], count: int = 1) -> Float[Tensor, "channel rows wrapped"]:
    """A picture in all directions with columns of its other end repeated on either side."""
    return torch.cat([picture[..., -count:], picture, picture[..., :count]], dim=2)


def blurred_around(
    pictures: Float[Tensor, "picture rows columns"], sigma: float
) -> Float[Tensor, "picture rows columns"]:
    """Pictures in all directions, of no negative values, blurred by a Gaussian of `sigma` degrees."""
    cells = sigma * pictures.shape[1] / 180
    more = min(math.ceil(3 * cells), pictures.shape[2])
    blurred = blur_texture(wrapped(pictures, more).permute(1, 2, 0).contiguous(), cells).permute(2, 0, 1)
    return blurred[..., more:-more].clamp(min=0.0)


def _unit(vectors: Float[Tensor, "3 height width"]) -> Float[Tensor, "3 height width"]:
    """Vectors divided by their lengths, several times as fast as torch's `normalize` along the first axis."""
    return vectors / vectors.square().sum(dim=0).sqrt()


def _resized(picture: Float[Tensor, "channel _ _"], size: list[int] | torch.Size) -> Float[Tensor, "channel _ _"]:
    """A picture at another resolution, interpolated between the centres of its corner pixels."""
    if tuple(picture.shape[1:]) == tuple(size):
        return picture
    return F.interpolate(picture[None], size=tuple(size), mode="bilinear", align_corners=True)[0]
