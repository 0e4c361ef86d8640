"""`neural-strands head`: the scalp of a head mesh, and its chart."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.streams import print_json


@dataclass(frozen=True)
class HeadCheck:
    """Load a head, find or check its scalp, sample roots on it, and draw the chart."""

    mesh: Annotated[Path | None, tyro.conf.Positional] = None
    """Head mesh (.obj, .ply, .stl, .glb), y up, +z out of the face; the built-in mannequin by default."""

    scalp: Path | None = None
    """Scalp: a chart (.json, .json.gz), a list of faces or vertices (.json), or a painted mask. Default:
    scalp_faces.json beside the mesh; without that, the scalp is found from the shape."""

    scale: float | None = None
    """Metres in one unit of the mesh; guessed from the head's width by default."""

    roots: int = 1000
    """Number of roots to sample and draw."""

    picture: Path | None = None
    """Where to write a picture of the chart and its roots (.png)."""

    seed: int = 0
    """Seed of the roots."""

    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> None:
        """Load, measure, draw."""
        from neural_strands.cli.device import seeded
        from neural_strands.foundation.errors import InputError
        from neural_strands.scalp.load import load_head
        from neural_strands.scalp.mannequin import mannequin
        from neural_strands.scalp.overlap import overlapping_faces
        from neural_strands.scalp.patches import pieces
        from neural_strands.scalp.roots import sample_roots

        if self.roots < 1:
            raise InputError(f"--roots {self.roots}: expected at least one root.")
        given = {"--scalp": self.scalp, "--scale": self.scale}
        if self.mesh is None and (found := [name for name, value in given.items() if value is not None]):
            raise InputError(
                f"{found[0]}: expected with a head mesh, found no mesh; name one, or leave {found[0]} out."
            )
        head = mannequin() if self.mesh is None else load_head(self.mesh, self.scalp, self.scale)
        roots = sample_roots(head, self.roots, seeded(self.seed))
        figures = {
            "vertices": len(head.mesh.vertices),
            "faces": len(head.mesh.faces),
            "height_m": round(float(head.mesh.vertices[:, 1].max() - head.mesh.vertices[:, 1].min()), 4),
            "scalp_faces": len(head.scalp_faces),
            "scalp_pieces": len(pieces(head.scalp_mesh.faces.numpy())),
            "scalp_area_cm2": round(1e4 * head.scalp_area, 1),
            "overlapping_pairs": len(overlapping_faces(head.scalp_uv)),
            "roots": len(roots),
        }
        if self.picture is not None:
            from neural_strands.pictures.encoding import write_png
            from neural_strands.pictures.plots import chart_plot

            write_png(self.picture, chart_plot(head.scalp_uv, roots.uv))
        if self.json:
            print_json(figures)
            return
        sys.stdout.write("".join(f"{name.replace('_', ' '):<20}{value}\n" for name, value in figures.items()))
