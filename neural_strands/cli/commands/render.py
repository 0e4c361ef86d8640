"""`neural-strands render`: images or a video of a fitted model."""

import itertools
import mimetypes
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import is_taken, write_json
from neural_strands.foundation.progress import track

if TYPE_CHECKING:
    import numpy as np

    from neural_strands.editing.edit_list import HairMotion
    from neural_strands.geometry.cameras import Camera
    from neural_strands.geometry.strands import Strands
    from neural_strands.model.outputs import RenderOutput
    from neural_strands.model.renderer import HairRenderer
    from neural_strands.runs.edited import EditedHair

VIDEO_SUFFIXES = (".mp4",)
"""Suffixes of --out that mean a video."""
RECORD = "render.json"
"""The file that marks a folder of images as written by `render`."""
FORMAT = 1
"""Version of the record's layout."""
MOST_CAMERAS = 100_000
"""Largest number of cameras on a turntable."""
MOST_POINTS = 10_000
"""Largest number of points per strand, as in `export`."""


@dataclass(frozen=True)
class Render:
    """Render fitted or edited hair from given cameras or on a turntable.

    The strands are decoded once. Images are PNG files, with the names and subfolders of the cameras; a video is MPEG-4.
    Hair that moves in the wind is rendered frame by frame, while the camera moves through the given ones.
    """

    model: Annotated[Path, tyro.conf.Positional]
    """Run, folder of its model, or edited folder."""
    out: Path
    """Folder for the images, or a .mp4 file. The folder has to be new or empty, or one that `render` wrote to before;
    there, images of the same names are replaced."""
    camera: Path | None = None
    """A transforms.json with the cameras (nerfstudio's format, OpenGL axes)."""
    turntable: Annotated[int, Between(1, MOST_CAMERAS)] | None = None
    """This many cameras on a circle around the hair, instead of --camera."""
    size: tuple[int, int] | None = None
    """Width and height in pixels. Default: the cameras' own, or 512 512 on the turntable."""
    alpha: bool = False
    """Only the hair, with its opacity in the alpha channel, instead of hair over body and background."""
    points: Annotated[int, Between(2, MOST_POINTS)] | None = None
    """Points per strand. Default: those of the model."""
    grain: Annotated[float, Between(0.0, 10.0)] = 0.0
    """Strength of the photographs' noise over the hair: 0 leaves it out, 1 draws as much as the photographs have."""
    fps: Annotated[float, Between(1.0, 240.0)] = 30.0
    """Frames per second of a video; hair in the wind uses those of the wind."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object instead of a sentence."""

    def run(self) -> None:
        """Decode, render, write."""
        import torch

        from neural_strands.editing.edit_list import hair_motion
        from neural_strands.runs.edited import open_hair

        self._check()
        opened = open_hair(self.model, pick_device(self.device))
        begin = time.perf_counter()
        with torch.inference_mode():
            strands = self._strands(opened)
            cameras = self._cameras(strands)
            motion = hair_motion(replace(opened.hair, strands=strands), opened.edits)
            renderer = self._renderer(opened, strands)
            frames = _frames(renderer, cameras, motion)
            count = len(cameras) if motion is None else motion.wind.frames
            with self._writer(cameras[0], self.fps if motion is None else motion.wind.fps) as write:
                for index, (name, output) in enumerate(track(frames, "rendering", total=count)):
                    drawn = renderer.with_grain(output, self.grain, seed=index) if self.grain else output
                    write(name, self._frame(drawn))
        result = {
            "frames": count,
            "seconds": round(time.perf_counter() - begin, 2),
            "out": str(self.out),
        }
        sentence = "{frames} frames in {seconds} s: {out}\n".format(**result)
        if self.json:
            print_json(result)
        else:
            sys.stdout.write(sentence)

    def _check(self) -> None:
        """Refuse arguments that contradict each other, before anything is loaded."""
        if (self.camera is None) == (self.turntable is None):
            raise InputError("render: expected either --camera or --turntable, found both or neither; give one.")
        if self.size is not None and not all(1 <= side <= 16384 for side in self.size):
            width, height = self.size
            raise InputError(
                f"--size: expected width and height from 1 to 16384 pixels, found {width} {height}; give another size."
            )
        kind, _ = mimetypes.guess_type(self.out.name)
        if kind is not None and kind.startswith(("video/", "image/")) and self.out.suffix.lower() not in VIDEO_SUFFIXES:
            raise InputError(
                f"{self.out}: expected a folder or a file that ends in .mp4, found one that ends in "
                f"{self.out.suffix}; name one of those."
            )
        if self.alpha and self.out.suffix.lower() in VIDEO_SUFFIXES:
            raise InputError(
                f"{self.out}: a video has no alpha channel; name a folder for --out, or leave out --alpha."
            )
        if self.out.suffix.lower() not in VIDEO_SUFFIXES and not (self.out / RECORD).is_file() and is_taken(self.out):
            raise InputError(
                f"{self.out}: expected a new or empty folder, or one that render wrote to, found another; name a new "
                "one."
            )

    def _strands(self, opened: "EditedHair") -> "Strands":
        """The strands as they were edited or, where none was, decoded with the points that are asked for."""
        from neural_strands.geometry.resample import resample

        if self.points is None:
            return opened.hair.strands
        if opened.edits:
            return resample(opened.hair.strands, self.points)
        return opened.fitted.modelled("render").decode(self.points)

    def _renderer(self, opened: "EditedHair", strands: "Strands") -> "HairRenderer":
        """Shows the strands; those that were edited, in the light that reaches them now."""
        from neural_strands.model.renderer import HairRenderer

        model = opened.fitted.modelled("render")
        if opened.edits:
            return replace(opened, hair=replace(opened.hair, strands=strands)).renderer("render")
        return HairRenderer.of(model, strands)

    def _cameras(self, strands: "Strands") -> "list[Camera]":
        from neural_strands.capture.transforms import read_transforms
        from neural_strands.geometry.turntable import turntable_cameras

        if self.camera is None:
            if not strands.points.isfinite().any():
                raise InputError("--turntable: expected a model with strands to turn around, found none; use --camera.")
            return turntable_cameras(strands.points, self.turntable or 1, self.size or (512, 512))
        if not self.camera.is_file():
            raise InputError(f"{self.camera}: expected a transforms.json with cameras, found no file; check the path.")
        cameras = [view.camera for view in read_transforms(self.camera)]
        return cameras if self.size is None else [camera.resized(*self.size) for camera in cameras]

    def _frame(self, output: "RenderOutput") -> "np.ndarray":
        """One frame as 8-bit RGB, with opacity where `alpha` asks for it."""
        from neural_strands.pictures.encoding import to_bytes

        return to_bytes(output.cutout if self.alpha else output.rgb)

    @contextmanager
    def _writer(self, first: "Camera", fps: float) -> "Iterator[Callable[[str, np.ndarray], None]]":
        """A function that takes the frames one by one, and puts them where `out` says."""
        from neural_strands.pictures.encoding import write_png
        from neural_strands.pictures.video import video_writer

        if self.out.suffix.lower() not in VIDEO_SUFFIXES:
            taken: set[str] = set()

            def write_image(name: str, frame: "np.ndarray") -> None:
                if not taken:
                    # Before the first image, so that those of a stopped rendering can be replaced, too.
                    write_json(self.out / RECORD, {"format": FORMAT})
                write_png(self.out / picture_name(name, taken), frame)

            yield write_image
            return
        with video_writer(self.out, (first.width, first.height), fps) as write:
            yield lambda _, frame: write(frame)


def _frames(
    renderer: "HairRenderer", cameras: "list[Camera]", motion: "HairMotion | None"
) -> "Iterator[tuple[str, RenderOutput]]":
    """Names and pictures: one per camera or, of hair that moves, one per frame."""
    if motion is None:
        for camera in cameras:
            yield camera.name, renderer.render(camera)
        return
    for frame in range(motion.wind.frames):
        camera = cameras[frame * len(cameras) // motion.wind.frames]
        blown = replace(renderer.strands, points=motion.at(frame / motion.wind.fps))
        yield f"{frame:04d}", renderer.showing(blown).render(camera)


def picture_name(camera: str, taken: set[str]) -> str:
    """The place of a camera's picture below the folder of all, of its own even where two cameras share a name.

    Args:
        camera: the camera's name; whatever of it would lead out of the folder is left out.
        taken: names that were given out before; the new one is added.
    """
    parts = [part for part in PurePosixPath(camera.replace("\\", "/")).parts if part not in ("/", "..")]
    plain = PurePosixPath(*parts).with_suffix("") if parts else PurePosixPath("view")
    candidates = itertools.chain([plain], (plain.with_name(f"{plain.name}_{k}") for k in itertools.count(2)))
    name = next(f"{candidate}.png" for candidate in candidates if f"{candidate}.png" not in taken)
    taken.add(name)
    return name
