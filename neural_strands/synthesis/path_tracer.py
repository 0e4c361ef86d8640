"""Path tracing of hair on a head with Mitsuba 3: pictures and the coverage of hair in them.

Strands are linear curves, so what is rendered is the polyline itself. The hair BSDF is that of Marschner et al. 2003 in
the form of d'Eon et al. 2011 and Chiang et al. 2016. Coverage comes from a second, cheap pass that only tests what each
camera ray meets first, with the same reconstruction filter as the picture.
"""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.srgb import to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.head import Head
from neural_strands.synthesis.backend import load_mitsuba
from neural_strands.synthesis.groom import covering_widths
from neural_strands.synthesis.pigment import AZIMUTHAL_ROUGHNESS, draw_melanin, melanin_colour, melanin_groups
from neural_strands.synthesis.scene_files import write_coloured_mesh, write_curves
from neural_strands.synthesis.styles import MELANIN, Melanin
from neural_strands.synthesis.surfaces import fine_mesh, skin_colours, surround

LONGITUDINAL_ROUGHNESS = 0.3
"""Roughness along the strand (0 to 1): the width of the highlight."""
OUTSHINE = 2.5
"""How many times brighter than the median of its neighbourhood a pixel may be in one pass."""
LIGHTS = (
    ((0.95, 2.5, 1.35), 0.8, (7.6, 7.1, 6.5)),
    ((-1.1, 2.5, -1.05), 0.8, (5.4, 5.8, 6.4)),
)
"""The two area lights: position relative to the middle of the hair (m), half a side (m), radiance."""


@dataclass(frozen=True)
class TracingConfig:
    """Quality and look of the pictures."""

    samples: int = 16
    """Paths per pixel."""
    mask_samples: int = 36
    """Rays per pixel for the coverage of hair."""
    depth: int = 12
    """Longest path (bounces + 1)."""
    pigments: int = 12
    """Groups of strands with similar melanin; each group shares one material."""
    passes: int = 4
    """Number of passes into which the samples are split, to remove fireflies."""
    melanin: Melanin = MELANIN["brown"]
    """Pigment of the hair."""
    light_turn: float = 0.0
    """Rotation of the lights about the vertical through the hair, degrees; 90 moves those in front to the left of the
    face."""


class PathTracer:
    """Strands on a head, ready to be rendered from any camera."""

    def __init__(
        self,
        head: Head,
        strands: Strands,
        config: TracingConfig,
        generator: torch.Generator,
        middle: Float[Tensor, "3"] | None = None,
    ) -> None:
        """Load the scene; geometry is passed through a temporary folder.

        Args:
            head: what the hair grows on.
            strands: the hair, world metres.
            config: quality and look.
            generator: draws pigments, skin and surroundings.
            middle: centre of the lights, world metres; by default the middle of the hair.

        Raises:
            InputError: Mitsuba is not installed, or a quality setting is out of range.
        """
        if min(config.samples, config.mask_samples, config.depth, config.pigments, config.passes) < 1:
            raise InputError("samples, mask_samples, depth, pigments and passes: expected at least 1 of each.")
        self._mi = load_mitsuba()
        self._config = config
        if middle is None:
            middle = (strands.points.amin(dim=(0, 1)) + strands.points.amax(dim=(0, 1))) / 2
        melanin = draw_melanin(config.melanin, len(strands), generator)
        with tempfile.TemporaryDirectory(prefix="neural-strands-") as folder:
            groups = _write_hair(Path(folder), strands, melanin, config.pigments)
            skin = Path(folder) / "head.ply"
            mesh, scalp_share = fine_mesh(head)
            colour = melanin_colour(melanin).mean(dim=0).to(mesh.vertices)
            write_coloured_mesh(skin, mesh, skin_colours(mesh.vertices, scalp_share, colour, generator))
            backdrop = self._mi.Bitmap(surround(64, generator).numpy())
            self._scene = self._mi.load_dict(self._lit(skin, groups, backdrop, middle.tolist()))
            self._silhouette = self._mi.load_dict(_silhouette(skin, [path for path, _ in groups]))

    def image(self, camera: Camera, seed: int) -> Float[Tensor, "height width 3"]:
        """The view of the camera, sRGB in [0, 1]; `seed` determines the noise."""
        passes = min(self._config.passes, self._config.samples)
        share = math.ceil(self._config.samples / passes)
        sensor = self._sensor(camera, share)
        rendered = [
            self._mi.render(self._scene, sensor=sensor, spp=share, seed=seed * passes + index)
            for index in range(passes)
        ]
        light = without_fireflies(torch.stack([torch.from_numpy(np.array(part)) for part in rendered]))
        return to_srgb(light.clamp(0.0, 1.0))

    def coverage(self, camera: Camera) -> Float[Tensor, "height width 2"]:
        """Share of each pixel in which the camera sees hair first, and in which it sees any part of the person."""
        sensor = self._sensor(camera, self._config.mask_samples)
        rendered = self._mi.render(self._silhouette, sensor=sensor, spp=self._config.mask_samples, seed=0)
        return torch.from_numpy(np.array(rendered))[..., :2].clamp(0.0, 1.0)

    def _sensor(self, camera: Camera, samples: int) -> Any:
        focal = float(camera.intrinsics[0, 0])
        offset = [
            0.5 - float(camera.intrinsics[0, 2]) / camera.width,
            0.5 - float(camera.intrinsics[1, 2]) / camera.height,
        ]
        # Mitsuba's cameras look along +z with +x to the left.
        flip = torch.diag(torch.tensor([-1.0, 1.0, -1.0, 1.0], dtype=torch.float64))
        to_world = camera.opengl_camera_to_world.double().cpu() @ flip
        return self._mi.load_dict(
            {
                "type": "perspective",
                "fov": math.degrees(2 * math.atan(camera.width / 2 / focal)),
                "fov_axis": "x",
                "principal_point_offset_x": offset[0],
                "principal_point_offset_y": offset[1],
                "near_clip": 0.01,
                "far_clip": 100.0,
                "to_world": self._mi.ScalarTransform4f(to_world.tolist()),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "pixel_format": "rgb",
                    "rfilter": {"type": "gaussian", "stddev": 0.45},
                },
                "sampler": {"type": "multijitter", "sample_count": samples},
            }
        )

    def _lit(
        self, skin: Path, groups: list[tuple[Path, Float[Tensor, "2"]]], backdrop: Any, middle: list[float]
    ) -> dict[str, Any]:
        """The scene for pictures."""
        scene: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": self._config.depth, "rr_depth": 5},
            "surround": {"type": "envmap", "bitmap": backdrop},
            "head": {
                "type": "ply",
                "filename": str(skin),
                "bsdf": {
                    "type": "principled",
                    "base_color": {"type": "mesh_attribute", "name": "vertex_color"},
                    "roughness": 0.5,
                    "specular": 0.35,
                },
            },
        }
        for index, (place, half_side, radiance) in enumerate(LIGHTS):
            around = turned_about_y(place, self._config.light_turn)
            origin = [a + b for a, b in zip(middle, around, strict=True)]
            look = self._mi.ScalarTransform4f().look_at(origin=origin, target=middle, up=[0, 1, 0])
            scene[f"light_{index}"] = {
                "type": "rectangle",
                "to_world": look @ self._mi.ScalarTransform4f().scale(half_side),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}},
            }
        for index, (path, melanin) in enumerate(groups):
            scene[f"hair_{index}"] = {
                "type": "linearcurve",
                "filename": str(path),
                "bsdf": {
                    "type": "hair",
                    "eumelanin": float(melanin[0]),
                    "pheomelanin": float(melanin[1]),
                    "longitudinal_roughness": LONGITUDINAL_ROUGHNESS,
                    "azimuthal_roughness": AZIMUTHAL_ROUGHNESS,
                },
            }
        return scene


def without_fireflies(passes: Float[Tensor, "pass height width 3"]) -> Float[Tensor, "height width 3"]:
    """Mean of several renderings of one view, without pixels that far outshine their neighbourhood in one pass.

    A highlight appears in every pass and at neighbouring pixels; a firefly is one rare path in one pass.
    """
    brightness = passes.amax(dim=-1)
    padded = torch.nn.functional.pad(brightness.mean(dim=0)[None, None], (1, 1, 1, 1), mode="replicate")
    around = torch.nn.functional.unfold(padded, 3).median(dim=1).values.reshape(brightness.shape[1:])
    limit = (OUTSHINE * around + 0.02) / brightness.clamp(min=1e-6)
    return (passes * limit.clamp(max=1.0)[..., None]).mean(dim=0)


def _write_hair(
    folder: Path, strands: Strands, melanin: Float[Tensor, "strand 2"], count: int
) -> list[tuple[Path, Float[Tensor, "2"]]]:
    """One file of curves for each group of similar pigment."""
    width = covering_widths(strands.points) if strands.width is None else strands.width
    written = []
    for index, (members, mean) in enumerate(melanin_groups(melanin, count)):
        path = folder / f"hair_{index}.txt"
        chosen = members.to(strands.points.device)
        write_curves(path, strands.points[chosen], width[chosen])
        written.append((path, mean))
    return written


def turned_about_y(place: tuple[float, float, float], degrees: float) -> tuple[float, float, float]:
    """Rotate a position about the y axis."""
    x, y, z = place
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return cosine * x + sine * z, y, cosine * z - sine * x


def _silhouette(skin: Path, hair: list[Path]) -> dict[str, Any]:
    """The scene for coverage: hair shows as red and green, skin as green, the surroundings as nothing."""
    scene: dict[str, Any] = {"type": "scene", "integrator": {"type": "aov", "aovs": "hair:albedo"}}
    scene["head"] = {"type": "ply", "filename": str(skin), "bsdf": _flat([0.0, 1.0, 0.0])}
    for index, path in enumerate(hair):
        scene[f"hair_{index}"] = {"type": "linearcurve", "filename": str(path), "bsdf": _flat([1.0, 1.0, 0.0])}
    return scene


def _flat(albedo: list[float]) -> dict[str, Any]:
    # Two-sided: a camera inside the bust's open bottom, or a curve seen from its far side, still counts.
    diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}
    return {"type": "twosided", "bsdf": diffuse}
