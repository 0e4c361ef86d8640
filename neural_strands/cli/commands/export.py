"""`neural-strands export`: hair for Blender, Houdini, Maya, Unreal and web pages."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.foundation.configs import Between


@dataclass(frozen=True)
class Export:
    """Write fitted or edited hair for other programs: .usd, .abc, .glb, .hair, .data, .tfx, .ply, .obj or .npz.

    Each strand has one colour, the median over the views that see it. USD and Alembic also hold guides, and one time
    sample per frame if the hair has wind; other formats hold the hair at rest.
    """

    source: Annotated[Path, tyro.conf.Positional]
    """Run, folder of a model, edited folder, or groom file (metres, y up)."""
    file: Annotated[Path, tyro.conf.Positional]
    """File to write; its suffix chooses the format. An existing file is replaced."""
    points: Annotated[int, Between(2, 10_000)] | None = None
    """Points per strand. Default: those of the hair."""
    guides: Annotated[int, Between(0, 100_000)] = 500
    """Number of guides in .usd and .abc; 0 for none."""
    blender: Path | None = None
    """Python with Blender's module bpy, to write .abc. Default: the one that runs this command."""
    device: DeviceName = "auto"
    """Where to compute."""

    def run(self) -> None:
        """Open, colour, write."""
        from neural_strands.grooms.scenes.alembic import Blender
        from neural_strands.grooms.scenes.scene import check_scene_path
        from neural_strands.runs.edited import open_hair
        from neural_strands.runs.export import ExportConfig, export_hair

        check_scene_path(self.file)
        blender = Blender(self.blender)
        if self.file.suffix.lower() == ".abc":
            blender.check()
        hair = open_hair(self.source, pick_device(self.device))
        written = export_hair(hair, self.file, ExportConfig(self.points, self.guides), blender)
        size = self.file.stat().st_size / 1e6
        sys.stderr.write(
            f"{self.file}: {len(written):,} strands of {written.points_per_strand} points, {size:.1f} MB.\n"
        )
