"""What a page shows: hair, head, segments and photographs, whichever of them there are."""

from dataclasses import dataclass
from pathlib import Path

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import Views
from neural_strands.model.renderer import HairRenderer


@dataclass(frozen=True, eq=False)
class Scene:
    """The content of a page.

    Attributes:
        path: the run, groom or capture.
        kind: what it is, for people: "run", "groom" or "capture".
        strands: world metres, on the CPU; None where there are none, as in a capture without ground truth.
        renderer: renders the hair of a run from any camera.
        head: mesh of head and body.
        segments: line segments that the fit used.
        photographs: read when they are asked for.
        note: what a person should know about this content, one sentence, or empty.
    """

    path: Path
    kind: str
    strands: Strands | None = None
    renderer: HairRenderer | None = None
    head: Mesh | None = None
    segments: LineSegments | None = None
    photographs: Views | None = None
    note: str = ""
