"""Frames by plain torch: within a block, stages of a frame run as the naive twins that tests compare them with."""

import contextlib
from collections.abc import Iterator
from unittest import mock

from neural_strands.model import hair_model
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster import resample
from neural_strands.raster.nodes import VisibleNodes
from neural_strands.raster.reference import rasterise_lines_reference
from neural_strands.raster.splat import splat_pyramid_reference


@contextlib.contextmanager
def plain_torch() -> Iterator[None]:
    """Decode sine by sine; draw, splat and blend without kernels; filter activations in several passes.

    Faces, visible parts, what lines leave open and the density keep their kernels.
    """
    with (
        mock.patch.object(StrandGenerator, "forward", StrandGenerator.reference),
        mock.patch.object(hair_model, "rasterise_lines", rasterise_lines_reference),
        mock.patch.object(hair_model, "splat_pyramid", splat_pyramid_reference),
        mock.patch.object(VisibleNodes, "blend", VisibleNodes.blend_reference),
        mock.patch.object(resample, "_is_fused", return_value=False),
    ):
        yield
