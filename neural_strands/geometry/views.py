"""Photographs with their cameras and masks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.rectangle import Rectangle

Image = Float[Tensor, "height width 3"]
"""A photograph, sRGB in [0, 1]."""
Mask = Float[Tensor, "height width"]
"""Share of each pixel that is covered, in [0, 1]."""
Part = Literal["image", "hair_mask", "person_mask"]
"""The parts of a view that can be read."""


@dataclass(frozen=True)
class View:
    """A photograph in memory.

    Attributes:
        camera: the calibrated camera, without lens distortion; its name is the view's.
        image: sRGB in [0, 1].
        hair_mask: coverage of hair, if it is known.
        person_mask: coverage of the whole person, if it is known.
    """

    camera: Camera
    image: Image
    hair_mask: Mask | None = None
    person_mask: Mask | None = None

    def cropped(self, part: Rectangle) -> "View":
        """Crop all parts of the view, and the camera accordingly."""
        return View(
            self.camera.cropped(part.left, part.top, part.width, part.height),
            part.of(self.image),
            None if self.hair_mask is None else part.of(self.hair_mask),
            None if self.person_mask is None else part.of(self.person_mask),
        )


@dataclass(frozen=True, eq=False)
class Views:
    """Views that are read on every access and not kept, so that memory does not grow with their number.

    Indexing reads a whole view; `image`, `hair_mask` and `person_mask` read only that part.

    Attributes:
        cameras: cameras of all views, known without reading files.
        has_hair_mask: whether each view has a hair mask, known without reading files.
        read: reads a part of the view at an index; returns None if the view lacks it.
        witnesses: number of views whose hair masks have to show that a place is empty.
    """

    cameras: tuple[Camera, ...]
    has_hair_mask: tuple[bool, ...]
    read: Callable[[int, Part], Tensor | None]
    witnesses: int = 1

    @classmethod
    def in_memory(cls, views: Sequence[View]) -> "Views":
        """Wrap views that are already in memory."""
        cameras, masked = tuple(view.camera for view in views), tuple(view.hair_mask is not None for view in views)
        return cls(cameras, masked, lambda index, part: getattr(views[index], part))

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, index: int) -> View:
        """Read all of a view."""
        return View(self.cameras[index], self.image(index), self.hair_mask(index), self.person_mask(index))

    def __iter__(self) -> Iterator[View]:
        """Read all views, one at a time."""
        return (self[index] for index in range(len(self)))

    def image(self, index: int) -> Image:
        """Read a view's photograph."""
        found = self.read(index, "image")
        if found is None:
            raise ValueError(f"{self.cameras[index].name}: expected a photograph, found none")
        return found

    def hair_mask(self, index: int) -> Mask | None:
        """Read a view's hair mask, if it has one."""
        return self.read(index, "hair_mask")

    def person_mask(self, index: int) -> Mask | None:
        """Read a view's person mask, if it has one."""
        return self.read(index, "person_mask")

    def hair_masks(self) -> Iterator[tuple[Camera, Mask]]:
        """Camera and hair mask of each view that has one, read one at a time without photographs."""
        for index, camera in enumerate(self.cameras):
            mask = self.hair_mask(index) if self.has_hair_mask[index] else None
            if mask is not None:
                yield camera, mask

    def selected(self, indices: Sequence[int]) -> "Views":
        """Some of the views, in the order of their indices here."""
        cameras = tuple(self.cameras[index] for index in indices)
        masked = tuple(self.has_hair_mask[index] for index in indices)
        return Views(cameras, masked, lambda index, part: self.read(indices[index], part), self.witnesses)

    def reduced(self, longest: int) -> "Views":
        """The views with at most `longest` pixels along their longer side; smaller ones stay as they are."""
        cameras = tuple(camera.reduced(longest) for camera in self.cameras)

        def read(index: int, part: Part) -> Tensor | None:
            found, camera = self.read(index, part), cameras[index]
            if found is None or found.shape[:2] == (camera.height, camera.width):
                return found
            # Each new pixel is the mean over the area that it covers, in linear light.
            light = to_linear(found) if part == "image" else found
            small = cv2.resize(light.cpu().numpy(), (camera.width, camera.height), interpolation=cv2.INTER_AREA)
            reduced = torch.from_numpy(small).to(found.device)
            return to_srgb(reduced) if part == "image" else reduced

        return Views(cameras, self.has_hair_mask, read, self.witnesses)
