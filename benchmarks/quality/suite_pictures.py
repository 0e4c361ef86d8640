"""The picture of a case of the suite: true and found strands, the distance between them, and a cut through both.

The first rows show true and found strands from the front, the side and behind, coloured by direction. The third shows
the found ones coloured by the distance from the nearest true strand. The last is a thin slab through the middle of the
head, seen from the side, with the head's outline: whether hair fills its inside shows only there.
"""

import cv2
import matplotlib as mpl
import numpy as np
import torch
import trimesh
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_queries import nearest
from neural_strands.pictures.encoding import to_bytes
from neural_strands.pictures.lines import lines_picture

SIDE = 480
"""Side of a view, pixels; views of the cut are half as large again."""
FILLED = 0.875
"""Share of a view that the hair's longest side takes."""
CAPTION = 26
"""Height of the line of text above a row, pixels."""
MOST_DRAWN = 5000
"""Largest number of strands in a view of whole strands; the cut shows all."""
FARTHEST = 0.010
"""Distance from true strands at which the colours end, metres."""
COLOURS = "viridis_r"
"""A perceptually uniform colour map: light is right, dark is wrong."""
SLAB = 0.006
"""Thickness of the cut, metres."""
FAR = 10.0
"""Distance of the camera from the cut, metres: far enough for lines of sight to be nearly parallel."""


def sheet(
    truth: Float[Tensor, "true point 3"], found: Float[Tensor, "found node 3"], head: Mesh
) -> Float[Tensor, "height width 3"]:
    """All rows with their captions."""
    low, high = truth.amin(dim=(0, 1)), truth.amax(dim=(0, 1))
    middle, size = 0.5 * (low + high), float((high - low).max())
    drawn = thinned(found)
    by_error = error_colours(errors(drawn, truth))
    wide = 3 * SIDE
    return torch.cat(
        [
            caption(f"true strands ({len(truth):,}), by direction", wide),
            around(thinned(truth), middle, size, head),
            caption(f"found strands ({len(found):,}), by direction", wide),
            around(drawn, middle, size, head),
            caption("found strands, by distance from the nearest true one:", wide, key=True),
            around(drawn, middle, size, head, by_error),
            caption(f"cut through the middle, {1e3 * SLAB:g} mm thick: true strands left, found ones right", wide),
            torch.cat([cut(points, middle, size, head) for points in (truth, found)], dim=1),
        ]
    )


def around(
    points: Float[Tensor, "strand point 3"],
    middle: Float[Tensor, "3"],
    size: float,
    head: Mesh,
    colours: Float[Tensor, "strand point 3"] | None = None,
) -> Float[Tensor, "height width 3"]:
    """Strands from the front, the side and behind."""
    views = []
    for away in ([0.0, 0.1, 1.0], [1.0, 0.1, 0.0], [0.0, 0.1, -1.0]):
        camera = Camera.look_at(middle + torch.tensor(away), middle, FILLED * SIDE / size, (SIDE, SIDE))
        views.append(lines_picture(points, camera, head, colours))
    return torch.cat(views, dim=1)


def cut(
    points: Float[Tensor, "strand point 3"], middle: Float[Tensor, "3"], size: float, head: Mesh
) -> Float[Tensor, "side side 3"]:
    """A slab of the hair, seen from the side, and the outline of the head in its middle."""
    across, side = float(0.5 * (head.vertices[:, 0].amin() + head.vertices[:, 0].amax())), 3 * SIDE // 2
    eye = middle + torch.tensor([FAR, 0.0, 0.0])
    camera = Camera.look_at(eye, middle, FAR * FILLED * side / size, (side, side))
    samples = to_bytes(lines_picture(pieces_within(points, across, SLAB), camera)).copy()
    ends = (camera.project(outline(head, across))[0] * 16).round().int().tolist()
    for start, end in ends:
        cv2.line(samples, start, end, (0, 0, 0), 2, cv2.LINE_AA, 4)
    return torch.from_numpy(samples).float() / 255


def pieces_within(
    points: Float[Tensor, "strand point 3"], across: float, thickness: float
) -> Float[Tensor, "piece 2 3"]:
    """The straight pieces of strands whose middle is in an upright slab.

    Args:
        points: strands, metres.
        across: middle of the slab along x, metres.
        thickness: thickness of the slab along x, metres.
    """
    pieces = torch.stack([points[:, :-1], points[:, 1:]], dim=2).reshape(-1, 2, 3)
    return pieces[(pieces[..., 0].mean(dim=1) - across).abs() <= 0.5 * thickness]


def outline(head: Mesh, across: float) -> Float[Tensor, "piece 2 3"]:
    """Where the head's surface crosses an upright plane at this x, metres, as straight pieces."""
    surface = trimesh.Trimesh(head.vertices.numpy(), head.faces.numpy(), process=False)
    pieces = trimesh.intersections.mesh_plane(surface, (1.0, 0.0, 0.0), (across, 0.0, 0.0))
    return torch.from_numpy(np.asarray(pieces, np.float32)).reshape(-1, 2, 3)


def errors(
    points: Float[Tensor, "strand point 3"], truth: Float[Tensor, "true node 3"]
) -> Float[Tensor, "strand point"]:
    """Distance of every point from the nearest true strand, metres, at most `FARTHEST`; directions do not count."""
    distance, _ = nearest(points.reshape(-1, 3), sample_strands(truth).points, FARTHEST)
    return distance.clamp(max=FARTHEST).reshape(points.shape[:2])


def error_colours(distance: Float[Tensor, "strand point"]) -> Float[Tensor, "strand point 3"]:
    """Colours of distances from 0 to `FARTHEST`."""
    colours = mpl.colormaps[COLOURS]((distance / FARTHEST).numpy())
    return torch.from_numpy(colours[..., :3].astype(np.float32))


def thinned(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "some point 3"]:
    """Evenly chosen strands, `MOST_DRAWN` at most."""
    return points[:: -(-len(points) // MOST_DRAWN)]


def caption(text: str, width: int, key: bool = False) -> Float[Tensor, "height width 3"]:
    """A line of text, with the key of the distances behind it if asked."""
    strip, ink, low = np.full((CAPTION, width, 3), 255, np.uint8), (0, 0, 0), CAPTION - 8

    def write(words: str, left: int) -> int:
        """Write from a column on; returns the column where the words end."""
        font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.5
        cv2.putText(strip, words, (left, low), font, size, ink, 1, cv2.LINE_AA)
        return left + cv2.getTextSize(words, font, size, 1)[0][0]

    end = write(text, 8)
    if key:
        start = write("0", end + 12) + 6
        ramp = error_colours(torch.linspace(0, FARTHEST, SIDE // 2)[None])
        strip[5 : CAPTION - 5, start : start + SIDE // 2] = to_bytes(ramp)
        write(f"{1e3 * FARTHEST:g} mm or more", start + SIDE // 2 + 6)
    return torch.from_numpy(strip).float() / 255
