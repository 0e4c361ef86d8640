"""Colours in closed form: body and background from the pixels that show them, hair from its strands' means.

Those of the background stay as they are; those of body and hair are where a fit starts.

Drawing body and background is linear in their colours, and so is sampling the appearance texture. The transpose of
each, which autograd computes, sums the pixels that see each texel.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.fitting.photographs.background_colours import background_colours
from neural_strands.fitting.photographs.background_distance import background_nearness, background_shot
from neural_strands.fitting.photographs.surround_weights import BESIDE, surround_weights
from neural_strands.foundation.gradients import weighted_gradient
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.compositing import drawn_share
from neural_strands.model.hair_model import HairModel
from neural_strands.model.surround.background import wrapped
from neural_strands.model.surround.hidden_skin import extend_over_mesh
from neural_strands.raster.dilation import widen
from neural_strands.raster.face_atlas import FaceAtlas
from neural_strands.raster.texture import blur_texture, sample_texture
from neural_strands.raster.triangles import TriangleBuffer
from neural_strands.raster.visible import visible_points

TINY = 1e-6
"""Weight below which a texel counts as unseen."""
FROM_CORNERS = 0.25
"""Weight of the colours at the corners of a face in that of a texel, pixels."""
HAIR_ALONE, AROUND, EVERYWHERE = 16, 4.0, 0.01
"""For the colour of hair: power of the hair's coverage by which pixels count, standard deviation of the surroundings
over which they are averaged, pixels, and weight of the mean of all hair, for places without dense hair."""
APART = 2
"""Pixels of the background that lie so few rows and columns from anything else do not count."""
AS_SEEN = 0.1
"""Weight with which the body also takes a pixel's colour as it is, relative to the body's share of the pixel. Under
dense hair, only noise is left once the light of the hair is removed."""
UNDER_HAIR = 0.6
"""Light of the scalp between roots, relative to that of the hair that grows there: stubble and shadow, which strands do
not show, hide the skin."""


def initialise_colours(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Initialise the colours of body and background, and the first three channels of Z_a to the hair's colour.

    Args:
        model: modified in place.
        strands: world metres, with `root_uv`.
        targets: photographs; those with a mask separate hair from the rest.
    """
    colour, weight = photographed_colours(model, strands, targets)
    _body(model, strands, targets, colour, weight)
    _background(model, strands, targets)
    _hair_texture(model, strands, colour, weight)


def initialise_hair_colours(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Initialise the first three channels of Z_a to the hair's colour; arguments as for `initialise_colours`."""
    _hair_texture(model, strands, *photographed_colours(model, strands, targets))


def _hair_texture(
    model: HairModel, strands: Strands, colour: Float[Tensor, "strand 3"], weight: Float[Tensor, " strand"]
) -> None:
    """Set the first three channels of Z_a to the `photographed_colours` of the strands."""
    seen = weight > TINY
    if strands.root_uv is None or not seen.any() or model.config.textures.appearance_channels < 3:
        return
    colour = to_srgb(colour)  # the point shader's output is encoded
    mean = (colour * weight[:, None]).sum(dim=0) / weight.sum()
    height, width, _ = model.textures.appearance.shape
    total, share = scatter_to_texture(colour[seen] - mean, strands.root_uv[seen], height, width)
    with torch.no_grad():
        model.shading.mean.copy_(mean)
        model.shading.decode[:, :3] = torch.eye(3, device=mean.device)
        knots = model.textures.appearance.unflatten(2, (model.textures.knots, -1))
        knots[..., :3] = fill_texture(total, share)[:, :, None]


@torch.no_grad()
def photographed_colours(
    model: HairModel, strands: Strands, targets: Views | Sequence[View]
) -> tuple[Float[Tensor, "strand 3"], Float[Tensor, " strand"]]:
    """Mean linear colour of the pixels that see each strand, weighted by the hair mask, and the sum of the weights."""
    device = strands.points.device
    total, weight = torch.zeros(len(strands), 3, device=device), torch.zeros(len(strands), device=device)
    for target in targets:
        lines = model.draw(strands, target.camera).lines
        visible = visible_points(lines, strands.points, model.config.supersample, strands.t)
        sure = visible.weight
        if target.hair_mask is not None:
            sure = sure * target.hair_mask.reshape(-1)[visible.pixel]
        light = to_linear(target.image).reshape(-1, 3)
        total.index_add_(0, visible.strand, light[visible.pixel] * sure[:, None])
        weight.index_add_(0, visible.strand, sure)
    return total / weight.clamp(min=TINY)[:, None], weight


def scatter_to_texture(
    values: Float[Tensor, "root channel"], uv: Float[Tensor, "root 2"], height: int, width: int
) -> tuple[Float[Tensor, "height width channel"], Float[Tensor, "height width 1"]]:
    """Scatter values at uv to a texture: sums weighted by the bilinear weights, and the sums of the weights."""
    image = values.new_zeros(height, width, values.shape[1] + 1, requires_grad=True)
    carried = torch.cat([values, torch.ones_like(values[:, :1])], dim=1)
    sums = weighted_gradient(sample_texture(image, uv), carried, image)
    return sums[..., :-1], sums[..., -1:]


def fill_texture(
    total: Float[Tensor, "height width channel"], weight: Float[Tensor, "height width 1"]
) -> Float[Tensor, "height width channel"]:
    """Weighted means of texels that have any weight; the others are filled from coarser and coarser halvings."""
    mean = total / weight.clamp(min=TINY)
    if min(total.shape[:2]) < 2:
        return mean
    coarse_total, coarse_weight = (
        F.avg_pool2d(image.permute(2, 0, 1)[None], 2, ceil_mode=True)[0].permute(1, 2, 0) for image in (total, weight)
    )
    coarse = fill_texture(coarse_total, coarse_weight).permute(2, 0, 1)[None]
    around = F.interpolate(coarse, size=total.shape[:2], mode="bilinear", align_corners=False)[0].permute(1, 2, 0)
    return torch.where(weight > TINY, mean, around)


def _body(
    model: HairModel,
    strands: Strands,
    targets: Views | Sequence[View],
    hair_colour: Float[Tensor, "strand 3"],
    hair_weight: Float[Tensor, " strand"],
) -> None:
    """Set each texel of the body to the mean of the pixels that show it; see `body_texture` for the others.

    A person mask determines which pixels show the body. Without one, it is also sampled between hair, in its shadow.
    Pixels count by how squarely the camera sees the surface: from the side, an error of the mesh moves the picture
    most.
    """
    colours = model.body.colour
    sums, weights = torch.zeros_like(colours), torch.zeros_like(colours)
    for target in targets:
        hair, light = _hair(model, strands, target), to_linear(target.image)
        seen = model.body.draw(target.camera)
        shown = model.body(target.camera, seen).colour
        surround = surround_weights(target, hair)
        share = (1 - hair) if surround is None else surround.body * (1 - hair)
        # Least squares for the body's colour: light = hair * (light of hair) + (1 - hair) * body.
        own = light - hair[..., None] * _light_of_hair(light, hair) + AS_SEEN * light
        part = (1 - hair + AS_SEEN)[..., None].expand_as(light)
        squarely = (share * _squarely(model.body.mesh, seen, target.camera))[..., None]
        sums += weighted_gradient(shown, own * squarely, colours, retain_graph=True)
        weights += weighted_gradient(shown, part * squarely, colours)
    with torch.no_grad():
        if weights.sum() > TINY:
            scalp = colours_under_hair(strands, hair_colour, hair_weight, model.body.mesh)
            texture = body_texture(sums, weights[..., :1], model.body.atlas, model.body.mesh, scalp)
            colours.copy_(texture.clamp(min=0.0))


def _background(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Set the distances of the background, and its colours."""
    background, directions = model.background, model.config.surround.background_directions
    shots = [background_shot(target, _background_share(model, strands, target), directions) for target in targets]
    otherwise = 1 / model.config.surround.background_distance
    nearness = background_nearness(shots, background.centre, directions, otherwise)
    background.nearness.copy_(wrapped(nearness[None]))
    # Weights are computed a second time: those of all photographs may not fit into memory.
    shared = ((target, _background_share(model, strands, target)) for target in targets)
    colours = background_colours(background, shared)
    if colours is not None:
        background.colour.copy_(wrapped(colours))


@torch.no_grad()
def _background_share(model: HairModel, strands: Strands, target: View) -> Float[Tensor, "height width"]:
    """Weight of each pixel in the background: none beside the person, where its colours may be mixed in.

    Without a mask of the person, the background is what has almost no hair and no body.
    """
    hair = _hair(model, strands, target)
    surround = surround_weights(target, hair)
    if surround is None:
        bare = model.body.draw(target.camera).face < 0
        share = torch.where(bare & (hair < BESIDE), 1 - hair, 0.0)
    else:
        share = surround.background
    other = widen((share == 0).float(), APART)
    return share * (1 - other)


def _light_of_hair(
    light: Float[Tensor, "height width 3"], hair: Float[Tensor, "height width"]
) -> Float[Tensor, "height width 3"]:
    """Mean colour of the hair around each pixel."""
    weight = hair.pow(HAIR_ALONE)[..., None]
    blurred = blur_texture(torch.cat([light * weight, weight], dim=2), AROUND).clamp(min=0.0)
    mean = (light * weight).sum(dim=(0, 1)) / weight.sum().clamp(min=TINY)
    return (blurred[..., :3] + EVERYWHERE * mean) / (blurred[..., 3:] + EVERYWHERE)


def colours_under_hair(
    strands: Strands, colour: Float[Tensor, "strand 3"], weight: Float[Tensor, " strand"], body: Mesh
) -> Float[Tensor, "vertex 4"]:
    """Colours of the scalp between roots: a darker shade of the hair that grows there.

    Args:
        strands: world metres.
        colour: linear, of each strand.
        weight: zero for strands that no photograph shows; where they grow, the colours around continue.
        body: the mesh on which the strands grow.

    Returns:
        colour of each vertex, and its share of scalp between roots, from 0 to 1; all shares are 0 if no photograph
        shows a strand.
    """
    known = (weight > TINY).to(colour)[:, None]
    found, sums = closest_points(strands.points[:, 0], body), colour.new_zeros(len(body.vertices), 5)
    values = torch.cat([known * UNDER_HAIR * colour, known, torch.ones_like(known)], dim=1)
    for corner, share in enumerate(found.barycentric.unbind(dim=1)):
        sums.index_add_(0, body.faces[found.face, corner], share[:, None] * values)
    shown = sums[:, 3]
    shade = extend_over_mesh(sums[:, :3] / shown.clamp(min=TINY)[:, None], shown.clamp(max=1.0), body)
    rooted = sums[:, 4:].clamp(max=1.0) * shown.any()
    return torch.cat([shade, rooted], dim=1)


def body_texture(
    total: Float[Tensor, "height width 3"],
    weight: Float[Tensor, "height width 1"],
    atlas: FaceAtlas,
    body: Mesh,
    scalp: Float[Tensor, "vertex 4"],
) -> Float[Tensor, "height width 3"]:
    """Weighted means of texels; those that few pixels show also take the colour at the corners of their face.

    Colours at vertices are means as well; where few pixels show them, they continue those around them.

    Args:
        total: sums of colours, weighted.
        weight: sums of weights, in pixels; more than zero for at least one texel.
        atlas: where the faces lie in the texture.
        body: the mesh whose texture it is.
        scalp: `colours_under_hair`, for vertices that less than a pixel shows; only skin continues around it.
    """
    texels = atlas.texels()
    texel, face, share = (part.to(total.device) for part in (texels.texel, texels.face, texels.barycentric))
    values = torch.cat([total, weight], dim=2).flatten(0, 1)
    corners = body.faces.to(total.device)[face]
    at_vertices = values.new_zeros(len(body.vertices), 4)
    for corner in range(3):
        at_vertices.index_add_(0, corners[:, corner], share[:, corner, None] * values[texel])
    seen = at_vertices[:, 3]
    colour = extend_over_mesh(at_vertices[:, :3] / seen.clamp(min=TINY)[:, None], seen.clamp(max=1.0), body)
    colour = torch.lerp(colour, scalp[:, :3], (scalp[:, 3] * (1 - seen).clamp(min=0.0))[:, None])
    around = (colour[corners] * share[..., None]).sum(dim=1)
    values[texel, :3] += FROM_CORNERS * around
    values[texel, 3:] += FROM_CORNERS
    return (values[:, :3] / values[:, 3:].clamp(min=TINY)).view_as(total)


def _squarely(body: Mesh, seen: TriangleBuffer, camera: Camera) -> Float[Tensor, "height width"]:
    """Squared cosine between each pixel's ray and the surface that it meets."""
    normals = face_normals(body)
    if len(normals) == 0:
        return torch.zeros_like(seen.depth)
    rays = F.normalize(camera.rays(camera.pixel_centres().view(-1, 2)), dim=-1)
    cosine = (normals[seen.face.view(-1).clamp(min=0)] * rays).sum(dim=-1)
    return cosine.square().view_as(seen.depth)


@torch.no_grad()
def _hair(model: HairModel, strands: Strands, target: View) -> Float[Tensor, "height width"]:
    """Share of each pixel that is hair: from its mask or, without one, from the drawn strands."""
    if target.hair_mask is not None:
        return target.hair_mask
    return drawn_share(model.draw(strands, target.camera).lines, model.config.supersample)
