"""train-networks from the command line: bad input is one sentence, before any fit."""

import pytest
from tiny_capture import write_capture

from neural_strands.cli.main import main
from neural_strands.runs import train_networks as training


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["networks.pt", "good"], "networks.pt: expected a name that ends in .safetensors"),
        (["networks.safetensors"], "captures: expected folders of captures, found none"),
        (["networks.safetensors", "good", "absent"], "absent"),
        (["networks.safetensors", "good", "--steps", "0"], "--steps: expected a whole number from 1"),
    ],
    ids=["suffix", "no capture", "absent capture", "no steps"],
)
def test_bad_input_is_one_sentence(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "run_fit", lambda *_: pytest.fail("a fit began"))
    write_capture(tmp_path / "good", views=4)
    assert main(["train-networks", *words]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["good"]
