"""Networks trained on captures in turn: the result is what fits in turn give, a stopped training continues, and a fit
starts from them."""

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Feedback
from neural_strands.model.networks import read_networks
from neural_strands.runs import run_fit as fits
from neural_strands.runs import train_networks as training
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.train_networks import train_networks

CPU = torch.device("cpu")


CONFIG = tiny_config(steps=4, initialise="mean")


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("captures")
    strands = [write_capture(folder / name, views=4) for name in ("one", "two")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
        # Stereo finds nothing in pictures as small as these.
        patch.setattr(fits, "find_segments", lambda *_: true_segments(strands[0]))
        yield [folder / "one", folder / "two"]


@pytest.fixture(scope="module")
def trained(captures, tmp_path_factory):
    """Networks of a training that nothing stopped."""
    path = tmp_path_factory.mktemp("trained") / "net.safetensors"
    train_networks(path, captures, CONFIG, CPU, Feedback())
    return path


def test_training_is_fits_in_turn(captures, trained, tmp_path):
    run_fit(FitRequest(captures[0], tmp_path / "a"), CONFIG, CPU, Feedback())
    first = tmp_path / "a" / "model" / "model.safetensors"
    second = run_fit(FitRequest(captures[1], tmp_path / "b", networks=first), CONFIG, CPU, Feedback())
    found, expected = read_networks(trained, CONFIG.model), second.model.state_dict()
    assert all(torch.equal(found[name], expected[name]) for name in found)
    # The start matters: without it the second fit gives something else.
    alone = run_fit(FitRequest(captures[1], tmp_path / "c"), CONFIG, CPU, Feedback())
    assert not torch.equal(alone.model.unet.output, second.model.unet.output)


def test_a_stopped_training_continues(captures, trained, tmp_path, monkeypatch):
    fit, calls = training.run_fit, []

    def stops_at_the_second(*arguments):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return fit(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(training, "run_fit", stops_at_the_second)
        with pytest.raises(KeyboardInterrupt):
            train_networks(tmp_path / "net.safetensors", captures, CONFIG, CPU, Feedback())
    assert not (tmp_path / "net.safetensors").exists()
    train_networks(tmp_path / "net.safetensors", captures, CONFIG, CPU, Feedback())
    assert (tmp_path / "net.safetensors").read_bytes() == trained.read_bytes()


def test_networks_that_do_not_fit_are_refused_before_anything_is_computed(captures, tmp_path):
    (tmp_path / "bad.safetensors").write_bytes(b"no weights")
    request = FitRequest(captures[0], tmp_path / "run", networks=tmp_path / "bad.safetensors")
    with pytest.raises(InputError, match="expected weights of networks, found something else"):
        run_fit(request, tiny_config(steps=2), CPU, Feedback())
    assert not (tmp_path / "run").exists()
