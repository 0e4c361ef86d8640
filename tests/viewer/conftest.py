"""A small run and the page that shows it, made once for all tests of the viewer."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.foundation.progress import Feedback
from neural_strands.lmvs.files import save_segments
from neural_strands.runs.run_fit import FitRequest, run_fit


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of a few steps, beside its capture; tests that change it copy it first."""
    place = tmp_path_factory.mktemp("viewed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(place / "none"))
        save_segments(place / "segments.npz", true_segments(write_capture(place / "ball")))
        request = FitRequest(place / "ball", place / "run", segments=place / "segments.npz")
        run_fit(request, replace(tiny_config(), steps=20), torch.device("cpu"), Feedback())
    return place / "run"
