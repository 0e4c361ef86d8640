"""The memory that a frame takes, so that a frame that is too large is refused before anything is allocated."""

import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.memory import free_memory
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands

LINE_PIXEL, PIXEL, HAIR_PIXEL = 42, 350, 600
"""Peak memory of a frame, bytes: for each pixel in which lines are drawn, for each pixel of the picture, and for each
pixel of the rectangle around the hair, which the image generator fills (measured on a CPU, 1024² and 2048²)."""
UNCHECKED = 2**31
"""A frame that takes less is not checked: asking the system would take longer than it is worth, bytes."""
MOST_LINE_PIXELS = 2**31 - 1
"""Largest number of pixels in which lines can be drawn; kernels count them with 32 bits."""


def frame_memory(strands: Strands, camera: Camera, supersample: int) -> int:
    """Estimate the peak memory of rendering a frame, bytes.

    Args:
        strands: world metres.
        camera: the view.
        supersample: pixels for lines per pixel of the picture, along each axis.
    """
    pixels = camera.width * camera.height
    return pixels * (LINE_PIXEL * supersample**2 + PIXEL) + round(HAIR_PIXEL * pixels * _hair_share(strands, camera))


def check_frame_memory(strands: Strands, camera: Camera, supersample: int) -> None:
    """Refuse a frame that does not fit into memory.

    Args:
        strands: world metres, on the device that will render them.
        camera: the view.
        supersample: pixels for lines per pixel of the picture, along each axis.

    Raises:
        InputError: it does not fit, as far as the system says what is free.
    """
    pixels = camera.width * camera.height
    frame = f"a frame of {camera.width} x {camera.height} pixels"
    if pixels * supersample**2 > MOST_LINE_PIXELS:
        raise InputError(
            f"{frame}: expected at most {MOST_LINE_PIXELS // supersample**2:,} pixels, found {pixels:,}; render a "
            "smaller one."
        )
    if pixels * (LINE_PIXEL * supersample**2 + PIXEL + HAIR_PIXEL) < UNCHECKED:
        return
    free, needed = _free(strands.points.device), frame_memory(strands, camera, supersample)
    if free is not None and needed > free:
        raise InputError(
            f"{frame}: expected {needed / 1e9:.1f} GB of free memory, found {free / 1e9:.1f} GB; render a smaller one."
        )


def _free(device: torch.device) -> int | None:
    if device.type != "cuda":
        return free_memory()
    # What torch has reserved but does not use is free as well.
    reserved = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return torch.cuda.mem_get_info(device)[0] + reserved


def _hair_share(strands: Strands, camera: Camera) -> float:
    """Share of the picture that the rectangle around the hair takes; all of it where hair is beside the camera."""
    pixels, depth = camera.to(strands.points.device).project(strands.points.reshape(-1, 3))
    if not len(pixels) or strands.points.device.type == "cuda" or not bool((depth > 0).all()):
        return float(len(pixels) > 0)
    size = pixels.new_tensor([camera.width, camera.height])
    low, high = (bound.clamp(min=0).minimum(size) for bound in (pixels.amin(dim=0), pixels.amax(dim=0)))
    return float(((high - low) / size).prod())
