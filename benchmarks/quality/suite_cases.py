"""The captures of the suite: which hair on which head, in which light, seen from where; and how they are made.

Grooms come from the shared data (their captures hold them in metres on their heads) or are procedural. A wound groom
keeps its strands as axes of waves or curls: locks share amplitude, length and phase, and each strand varies slightly.
Windings of the test half differ from those of the tuning half, and so do its lights except for long_fine_waves'; the
procedural styles occur in both halves.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.flow.curls import wound as wound_about
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.point_queries import assign_locks
from neural_strands.geometry.resample import resample
from neural_strands.geometry.strands import Strands, lengths_along
from neural_strands.grooms.io import read_groom
from neural_strands.scalp.fit_similarity import fit_similarity
from neural_strands.scalp.head import Head
from neural_strands.scalp.load import load_head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.dome import DomeConfig
from neural_strands.synthesis.groom import GRID_MARGIN, GRID_SPACING, covering_widths, make_groom
from neural_strands.synthesis.path_tracer import TracingConfig
from neural_strands.synthesis.styles import MELANIN, STYLES, HairColour, StyleName
from neural_strands.synthesis.synthesize import SynthesisConfig, synthesize

HeadName = Literal["mannequin", "makehuman", "ict"]

POINTS = 200
"""Points of a wound strand: ten or more for each turn."""
LOCK = 0.014
"""Distance between locks on the scalp, metres."""


@dataclass(frozen=True)
class Winding:
    """A wave or a curl about a strand's course."""

    radius: float
    """Deviation from the axis, metres."""
    pitch: float
    """Length of a wave along the axis, metres."""
    roundness: float = 1.0
    """Deviation outwards as a share of that sideways: 0 is a flat wave, 1 a helix."""


@dataclass(frozen=True)
class Case:
    """One capture of the suite."""

    name: str
    """Name of the case and of its folder."""
    half: Literal["tuning", "test"]
    """Which half it belongs to."""
    groom: Literal["sintel_bob", "straight_long", "wavy_long"] | StyleName
    """A groom of the shared data, or a style."""
    winding: Winding | None = None
    """Wave or curl to add; None for none."""
    kept: int | None = None
    """Number of strands kept of a captured groom, drawn at random; the fewer, the thicker they are. None: all."""
    length: float | None = None
    """Length of procedural hair that is not cut level, metres; None leaves the style's length and cut."""
    head: HeadName = "makehuman"
    """Head of procedural grooms and of wavy_long; captured grooms have their own."""
    colour: HairColour = "brown"
    """Pigment."""
    widths: float = 1.0
    """Factor on the strands' widths."""
    light_turn: float = 0.0
    """Rotation of the lights, degrees."""
    views: int = 24
    """Number of cameras."""
    azimuth: float = 180.0
    """Farthest camera from the face, degrees about the vertical."""
    resolution: int = 384
    """Width and height of the pictures, pixels."""
    samples: int = 8
    """Paths per pixel."""
    strands: int = 8000
    """Of procedural grooms."""
    seed: int = 0
    """Seed of all random numbers."""


THICK = Case("thick_long", "tuning", "straight_long", kept=4867, resolution=448, samples=16, light_turn=-45, seed=8)
"""Long hair of few strands."""
CASES = (
    Case("wavy_long", "tuning", "wavy_long"),
    Case("bob_waves", "tuning", "sintel_bob", Winding(0.005, 0.045, 0.4), colour="auburn"),
    Case("long_curls", "tuning", "straight_long", Winding(0.005, 0.028), colour="brown", light_turn=60),
    Case("wavy_style", "tuning", "wavy", head="mannequin", colour="black", views=32),
    Case("straight_style", "tuning", "straight", head="mannequin", colour="blond", views=20),
    Case("long_ringlets", "tuning", "wavy_long", Winding(0.005, 0.032), colour="brown", light_turn=45, seed=4),
    Case("bob_coils", "tuning", "sintel_bob", Winding(0.003, 0.015), colour="black", light_turn=-60, views=32),
    Case("wavy_curls", "tuning", "wavy_long", Winding(0.004, 0.024), colour="blond", light_turn=-120, seed=1),
    Case("straight_bob", "tuning", "sintel_bob", colour="grey", widths=1.3, light_turn=180, views=20, seed=1),
    Case("wavy_style_ict", "tuning", "wavy", head="ict", colour="auburn", azimuth=110, views=20, light_turn=75, seed=5),
    Case("curly_style_mannequin", "tuning", "curly", head="mannequin", colour="auburn", light_turn=-30, seed=6),
    Case("over_shoulders", "tuning", "straight", length=0.5, colour="black", light_turn=15, samples=16, seed=7),
    THICK,
    replace(THICK, name="thick_long_curls", winding=Winding(0.005, 0.028)),
    Case("wavy_long_clear", "tuning", "wavy_long", views=30, resolution=448, samples=24),
    Case("long_waves", "test", "straight_long", Winding(0.008, 0.06, 0.5), colour="auburn", light_turn=120, seed=1),
    Case("wavy_style_front", "test", "wavy", head="makehuman", azimuth=100, views=20, light_turn=30, seed=2),
    Case("curly_style", "test", "curly", head="ict", colour="brown", light_turn=150, views=32, seed=3),
    Case("bob_big_curls", "test", "sintel_bob", Winding(0.012, 0.05), colour="brown", light_turn=-150, seed=2),
    Case("short_style", "test", "short", head="ict", colour="black", views=16, light_turn=90, seed=4),
    Case("long_fine_waves", "test", "straight_long", Winding(0.002, 0.02, 0.3), colour="black", views=40, seed=3),
)


def build(case: Case, data: Path, folder: Path) -> int:
    """Render the missing views of a case into its folder and return their number."""
    generator = torch.Generator().manual_seed(case.seed)
    head, strands = grown(case, data, generator)
    if case.winding is not None:
        strands = wound(strands, head, case.winding, generator)
    width = case.widths * covering_widths(strands.points)
    config = SynthesisConfig(
        DomeConfig(views=case.views, resolution=case.resolution, azimuth=case.azimuth),
        TracingConfig(case.samples, mask_samples=16, melanin=MELANIN[case.colour], light_turn=case.light_turn),
        case.seed,
    )
    return synthesize(folder, head, replace(strands, width=width), config, {"case": case.name, "groom": case.groom})


def grown(case: Case, data: Path, generator: torch.Generator) -> tuple[Head, Strands]:
    """The head of a case and its hair before winding, metres."""
    if case.groom in ("sintel_bob", "straight_long"):
        capture = Capture.load(data / "captures" / case.groom)
        if capture.ground_truth is None:
            raise SystemExit(f"{capture.folder}: expected true strands, found none.")
        strands = capture.ground_truth
        if case.kept is not None:
            strands = strands.select(torch.randperm(len(strands), generator=generator)[: case.kept])
        return find_head(capture), strands
    head = _head(case.head, data)
    if case.groom == "wavy_long":
        strands = read_groom(data / "grooms" / "wavy_long" / "harolongo.data").strands()
        back = fit_similarity(head, strands.points[:, 0]).inverse()
        return head, Strands(back.apply(strands.points))
    style = STYLES[case.groom]
    if case.length is not None:
        style = replace(style, length=case.length, tip_level=None)
    return head, make_groom(head, style, MELANIN[case.colour], case.strands, generator)


def wound(strands: Strands, head: Head, winding: Winding, generator: torch.Generator) -> Strands:
    """Lay a wave or a curl over every strand; it grows from nothing at the root within a wave.

    Strands are lifted off the head by as much as a curl would enter it.
    """
    points = resample(strands, POINTS).points
    lock = assign_locks(points[:, 0], LOCK, generator)

    def drawn(shared: float, own: float) -> Float[Tensor, "strand 1"]:
        """Deviations of unit scale: shared by each lock, and of each strand."""
        each = torch.randn(2, len(points), 1, generator=generator)
        return shared * each[0][lock] + own * each[1]

    length = lengths_along(points)
    pitch = winding.pitch * torch.exp(drawn(0.1, 0.01))
    phase = 2 * math.pi * (length / pitch + drawn(0.5, 0.05))
    risen = (length / winding.pitch).clamp(max=1)
    size = winding.radius * torch.exp(drawn(0.15, 0.1)) * risen * risen * (3 - 2 * risen)
    normals = torch.nn.functional.normalize(points[:, 0] - head.mesh.vertices.mean(dim=0), dim=-1)
    curves = wound_about(points, normals, size, phase, winding.roundness)
    height, outward = SignedDistanceGrid.build(head.mesh, GRID_SPACING, GRID_MARGIN).with_outward(points)
    lift = (size - height.clamp(min=0.0)).clamp(min=0.0)
    return Strands(curves + lift[..., None] * outward)


def _head(name: HeadName, data: Path) -> Head:
    if name == "mannequin":
        return mannequin()
    folder = data / "heads" / name
    if name == "makehuman":
        return load_head(folder / "base.obj", folder / "scalp_solid.json.gz")
    return load_head(folder / "generic_neutral_mesh.obj")
