"""Results of a fit: the model, the groom for other programs, a preview."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import interpolate

from neural_strands.fitting.first_colours import photographed_colours
from neural_strands.fitting.fit_data import FitData
from neural_strands.fitting.unseen_appearance import FACING, fill_unseen_appearance
from neural_strands.flow.unseen import UnseenConfig, unseen_parts
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.model.files import save_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.model.renderer import HairRenderer
from neural_strands.model.thickness import strand_widths
from neural_strands.pictures.encoding import write_png
from neural_strands.runs.run_folder import RunFolder

PREVIEW_SIDE = 1024
"""Longer side of the preview's rendering, pixels: a whole large photograph could take more memory than the fit."""


@torch.no_grad()
def write_outputs(folder: RunFolder, model: HairModel, data: FitData, notes: dict[str, str]) -> Strands:
    """Write the model and the groom of a fit, finished or stopped; returns the strands.

    First, hair that photographs hardly show takes its appearance from its neighbours.

    Raises:
        InputError: the folder cannot be written.
    """
    strands = model.decode()
    kinds = (UnseenConfig(), UnseenConfig(facing=FACING))
    parts, grazed = parts_unseen(strands, data.views.cameras, data.head.mesh, kinds)
    fill_unseen_appearance(model, strands, data.views, grazed)
    width, color = strand_widths(model, strands), groom_colours(model, strands, data)
    unseen = parts.to(strands.points).mean(dim=1)
    coloured = replace(strands, width=width, color=color, unseen=unseen).to("cpu")
    save_hair_model(model, folder.model, notes)
    for path in (folder.groom, folder.groom_arrays):
        write_groom(path, Groom.from_strands(coloured))
    return coloured


def parts_unseen(
    strands: Strands, cameras: Sequence[Camera], head: Mesh, configs: Sequence[UnseenConfig] = (UnseenConfig(),)
) -> list[Bool[Tensor, "strand part"]]:
    """Which parts of the strands, from root to tip, too few of the fit's cameras could see, by each definition."""
    index = MeshIndex(head)
    before = [HeadView.of(camera, index) for camera in cameras]
    return unseen_parts(strands.points, before, SignedDistanceIndex(head), configs)


@torch.no_grad()
def groom_colours(model: HairModel, strands: Strands, data: FitData) -> Float[Tensor, "strand 3"]:
    """Linear RGB of each strand: mean of the pixels that see it; a strand that no view sees takes its neighbour's."""
    colours, weight = photographed_colours(model, strands, data.views)
    known = weight > 0
    if known.any() and not known.all():
        roots = strands.points[:, 0]
        _, index = nearest(roots[~known], roots[known], radius=1.0)
        colours[~known] = colours[known][index.clamp(min=0)]
    return colours


def write_preview(path: Path, model: HairModel, points: Float[Tensor, "root point 3"], data: FitData) -> None:
    """Write a training view as the model currently renders it, beside its photograph, both at most `PREVIEW_SIDE`."""
    target = data.views[0]
    camera = target.camera.reduced(PREVIEW_SIDE)
    output = HairRenderer.of(model, Strands(points, root_uv=model.root_uv)).render(camera)
    photograph = interpolate(target.image.permute(2, 0, 1)[None], (camera.height, camera.width), mode="area")
    write_png(path, torch.cat([output.rgb, photograph[0].permute(1, 2, 0)], dim=1))
