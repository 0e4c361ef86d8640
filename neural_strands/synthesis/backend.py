"""Mitsuba, loaded when it is first needed."""

import importlib
from types import ModuleType

import torch

from neural_strands.foundation.errors import InputError


def load_mitsuba() -> ModuleType:
    """Import Mitsuba and select its variant: CUDA where torch sees it, else the scalar one.

    The LLVM variant is left alone: it depends on the LLVM library it finds and ends the process when that is too old.
    Mitsuba holds one variant a thread; whoever else uses it in this process should select their own again.

    Raises:
        InputError: Mitsuba is not installed.
    """
    try:
        mitsuba = importlib.import_module("mitsuba")
    except ImportError as error:
        raise InputError(
            "path tracing needs Mitsuba 3, which is not installed; run: pip install neural-strands[synthesis]"
        ) from error
    variant = "cuda_ad_rgb" if torch.cuda.is_available() else "scalar_rgb"
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba
