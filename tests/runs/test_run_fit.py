"""A fit as a run: what is refused leaves nothing that blocks the next one."""

from dataclasses import replace

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Feedback
from neural_strands.runs import run_fit as run_fit_module
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.run_folder import RunFolder

CPU = torch.device("cpu")


def test_stereo_that_finds_too_little_blocks_no_later_fit(tmp_path, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    segments = true_segments(write_capture(tmp_path / "ball"))
    request = FitRequest(tmp_path / "ball", tmp_path / "run")
    config = replace(tiny_config(), steps=2, initialise="mean")
    folder, said = RunFolder(request.out), []
    monkeypatch.setattr(run_fit_module, "find_segments", lambda *_: segments.select(torch.arange(20)))
    with pytest.raises(InputError, match="500 segment points or more, found 20"):
        run_fit(request, config, CPU, Feedback(said.append))
    assert not folder.description.exists()
    assert not folder.segments.exists()
    assert "line-based multi-view stereo over the training views" in said
    monkeypatch.setattr(run_fit_module, "find_segments", lambda *_: segments)
    assert run_fit(request, config, CPU, Feedback()).step == 2
    assert folder.description.is_file()
