"""The command line as a user meets it: exit statuses, sentences, help."""

import subprocess
import sys

import pytest

from neural_strands.cli import device as device_choice
from neural_strands.cli.main import COMMANDS, main
from neural_strands.foundation.errors import InputError


def run(arguments: list[str], capsys: pytest.CaptureFixture) -> tuple[int, str, str]:
    """Status, standard output and standard error of one command."""
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 1
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_help_of_every_command(verb: str, capsys: pytest.CaptureFixture):
    status, out, err = run([verb, "--help"], capsys)
    assert status == 0
    assert verb in out
    assert "Traceback" not in out + err


def test_help_lists_every_command(capsys: pytest.CaptureFixture):
    status, out, _ = run(["--help"], capsys)
    assert status == 0
    for verb in COMMANDS:
        assert verb in out


@pytest.mark.parametrize("arguments", [["frobnicate"], ["info"], ["info", "a.hair", "--nonsense"]])
def test_wrong_words_exit_with_2(arguments: list[str], capsys: pytest.CaptureFixture):
    status, _, err = run(arguments, capsys)
    assert status == 2
    assert "Traceback" not in err


def test_bad_input_is_one_sentence(capsys: pytest.CaptureFixture):
    status, out, err = run(["info", "there/is/none.hair"], capsys)
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("neural-strands: ")
    assert err.endswith(".\n")
    assert "none.hair" in err


def test_interruption_exits_with_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("neural_strands.cli.info.Info.run", stop)
    status, _, err = run(["info", "a.hair"], capsys)
    assert status == 130
    assert "Traceback" not in err


def test_programming_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch):
    def fail(_: object) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr("neural_strands.cli.info.Info.run", fail)
    with pytest.raises(ValueError, match="a bug"):
        main(["info", "a.hair"])


def test_module_runs_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "neural_strands", "info", "none.hair"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def test_device_choice(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert device_choice.pick_device("auto").type == "cpu"
    assert device_choice.pick_device("cpu").type == "cpu"
    with pytest.raises(InputError, match="expected a CUDA device"):
        device_choice.pick_device("cuda")


def test_seeds_repeat():
    draws = [device_choice.seeded(3).initial_seed() for _ in range(2)]
    assert draws == [3, 3]
