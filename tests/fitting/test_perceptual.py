"""The perceptual distance of fits on a machine without network."""

import urllib.error
import urllib.request
from pathlib import Path

import pytest
import torch

from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.fitting.perceptual import perceptual_loss
from neural_strands.foundation.published_files import FOLDER_VARIABLE


def test_fits_without_network_attempt_one_download(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    asked: list[str] = []

    def refuse(address: str, timeout: float) -> None:
        asked.append(address)
        raise urllib.error.URLError("no network")

    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(urllib.request, "urlopen", refuse)
    said: list[str] = []
    for _ in range(3):
        assert perceptual_loss(torch.device("cpu"), said.append) is structural_loss
    assert len(asked) == 1
    assert "cannot be reached" in said[0]
    assert "could not be fetched within the last hour" in said[1]
    assert all(line.endswith("training uses the structural loss instead") for line in said)
