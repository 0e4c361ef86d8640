"""Every command whose output cannot be written says so in one sentence, before long work."""

import pytest
from read_only import read_only_folder

from neural_strands.cli.main import main


@pytest.mark.parametrize(
    "words",
    [
        ["convert", "run/groom.npz", "OUT.ply"],
        ["convert", "run/groom.npz", "OUT.usd"],
        ["export", "run", "OUT.usd"],
        ["export", "run", "OUT.glb"],
        ["edit", "run", "OUT", "haircut", "--length", "0.01"],
        ["fit", "capture", "OUT", "--segments", "segments.npz"],
        ["fit", "capture", "OUT/deeper", "--segments", "segments.npz"],
        ["lmvs", "capture", "OUT"],
        ["render", "run", "--out", "OUT", "--turntable", "1", "--size", "16", "16"],
        ["render", "run", "--out", "OUT.mp4", "--turntable", "1", "--size", "16", "16"],
        ["head", "capture/head.obj", "--picture", "OUT.png"],
        ["train-prior", "OUT.safetensors"],
        ["train-networks", "OUT.safetensors", "capture"],
        ["prior-traverse", "OUT"],
    ],
    ids=" ".join,
)
def test_a_read_only_folder_is_one_sentence(words, made_workspace, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(made_workspace)
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    out = str(read_only_folder(tmp_path / "read-only") / "out")
    assert main([word.replace("OUT", out) for word in words]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"neural-strands: {out}")
    assert "cannot be written (" in said
    assert "(: " not in said
