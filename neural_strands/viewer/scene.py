"""The content of a page: hair, head, segments and photographs, as far as they exist."""

from dataclasses import dataclass, replace
from pathlib import Path

from neural_strands.editing.edit_list import apply_edits, fitted_per_strand
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Edit, Haircut, Wind
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
        kind: kind of content, for messages: "run", "groom" or "capture".
        fitted: hair as it was fitted or read; None if there is none, as in a capture without true strands.
        edits: edits that are applied to it.
        hair: the hair after the edits.
        unedited: renders the fitted hair of a model from any camera.
        renderer: renders the edited hair of a model from any camera.
        head: mesh of head and body.
        segments: line segments that the fit used.
        photographs: photographs, read when they are needed.
        note: one sentence that the user should know about the content, or empty.
    """

    path: Path
    kind: str
    fitted: Hair | None = None
    edits: tuple[Edit, ...] = ()
    hair: Hair | None = None
    unedited: HairRenderer | None = None
    renderer: HairRenderer | None = None
    head: Mesh | None = None
    segments: LineSegments | None = None
    photographs: Views | None = None
    note: str = ""

    @property
    def strands(self) -> Strands | None:
        """The edited strands, on the CPU."""
        return None if self.hair is None else self.hair.strands.to("cpu")

    def with_hair(self, fitted: Hair) -> "Scene":
        """The scene with other hair, without edits."""
        unedited = None if fitted.model is None else HairRenderer.of(fitted.model, fitted.strands)
        return replace(self, fitted=fitted, unedited=unedited).with_edits(())

    def with_edits(self, edits: tuple[Edit, ...]) -> "Scene":
        """The scene with other edits of its hair.

        Raises:
            InputError: an edit does not suit the hair.
        """
        if self.fitted is None:
            return self
        if self.hair is not None and edits and edits[:-1] == self.edits and isinstance(edits[-1], Haircut | Wind):
            # These edits apply to the result of all others, so no texture has to be decoded again.
            hair = apply_edits(self.hair, edits[-1:])
        else:
            hair = apply_edits(self.fitted, edits) if edits else self.fitted
        renderer = None
        if self.unedited is not None:
            renderer = self.unedited.showing(hair.strands, fitted_per_strand(self.fitted.strands, edits))
        return replace(self, edits=edits, hair=hair, renderer=renderer)
