"""Mitsuba, loaded on first use."""

import importlib
from types import ModuleType

import torch

from neural_strands.foundation.errors import InputError


def load_mitsuba() -> ModuleType:
    """Import Mitsuba and select its variant: CUDA if torch has it, otherwise scalar.

    The LLVM variant is not used: it depends on the LLVM library of the system and ends the process if that is too old.
    Mitsuba keeps one variant per thread, so other users in this process should select theirs again.

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
