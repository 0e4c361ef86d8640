"""The command line as a user meets it: exit statuses, sentences, help."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from neural_strands import __version__
from neural_strands.cli import device as device_choice
from neural_strands.cli.main import COMMANDS, main
from neural_strands.foundation.errors import InputError

LOCALES = (("C", "ascii"), ("C.UTF-8", "utf-8"))


def run(arguments: list[str], capsys: pytest.CaptureFixture) -> tuple[int, str, str]:
    """Status, standard output and standard error of one command."""
    status = main(arguments)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_help_of_every_command(verb: str, capsys: pytest.CaptureFixture):
    status, out, err = run([verb, "--help"], capsys)
    assert status == 0
    assert verb in out
    assert "Traceback" not in out + err


def test_help_lists_every_command(capsys: pytest.CaptureFixture):
    for words in ([], ["-h"], ["--help"]):
        status, out, _ = run(words, capsys)
        assert status == 0
        for name, verb in COMMANDS.items():
            assert f"  {name} " in out
            assert verb.summary in out


def test_help_loads_nothing_heavy():
    script = (
        "import sys\nfrom neural_strands.cli.main import COMMANDS, main\n"
        "for verb in (None, *(verb for verb in COMMANDS if verb != 'train-prior')):\n"
        "    assert main([verb, '--help'] if verb else ['--help']) == 0\n"
        "    heavy = {'torch', 'numpy', 'warp', 'scipy', 'cv2'} & set(sys.modules)\n"
        "    assert not heavy, (verb, heavy)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_version(capsys: pytest.CaptureFixture):
    assert run(["--version"], capsys) == (0, f"neural-strands {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("frobnicate", "'frobnicate': expected a command, such as fit"),
        ("inof a.hair", "'inof': expected a command, such as info"),
        ("info", "FILE: expected a value, found none"),
        ("info a.hair --jsn", "--jsn: expected an option such as --json, found none of that name"),
        ("info a.hair b.hair", "b.hair: expected no further words"),
        ("fit a b --hold_out 3", "--hold-out: expected an option such as --"),
        ("fit a b --steps", "--steps: expected a value, found none"),
        ("fit a b --steps x", "--steps: expected a whole number, found 'x'"),
        ("fit a b --minutes x", "--minutes: expected a number, found 'x'"),
        ("fit a b --preset slow", "--preset: expected one of 'demo', 'fast', 'paper', found 'slow'"),
        ("edit a b density", "--strands: expected a value, found none"),
        ("edit a b blow", "blow: expected one of haircut, density, "),
        ("edit a b haircut --length 1 more", "more: expected no further words"),
        ("synthesize a --views 0", "--views: expected a whole number from 1 to 100000, found 0"),
        ("render m --out x --turntable 0", "--turntable: expected a whole number from 1 to 100000, found 0"),
        ("lmvs a b --up 1 2", "--up: expected 3 values, found fewer"),
        ("render m --out x --size 3", "--size: expected INT INT, found '3'"),
    ],
)
def test_wrong_words_are_one_sentence(words: str, sentence: str, capsys: pytest.CaptureFixture):
    status, out, err = run(words.split(), capsys)
    assert status == 2
    assert out == ""
    assert err.startswith(f"neural-strands: {sentence}")
    assert err.endswith(".\n")
    assert err.count("\n") == 1


def test_a_subcommand_has_its_own_help(capsys: pytest.CaptureFixture):
    _, _, err = run(["edit", "a", "b", "wind", "--foo"], capsys)
    assert err == (
        "neural-strands: --foo: expected an option such as --fps, found none of that name; "
        "`neural-strands edit a b wind --help` lists its options.\n"
    )


def test_sentences_do_not_depend_on_the_locale():
    told = {shell(f"LC_ALL={locale} PYTHONIOENCODING={codec} $N info") for locale, codec in LOCALES}
    assert told == {
        (2, "neural-strands: FILE: expected a value, found none; `neural-strands info --help` lists its options.\n")
    }


def test_help_shows_no_none_among_the_values(capsys: pytest.CaptureFixture):
    for verb in COMMANDS:
        _, out, _ = run([verb, "--help"], capsys)
        assert "{None}" not in out


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

    monkeypatch.setattr("neural_strands.cli.commands.info.Info.run", stop)
    status, _, err = run(["info", "a.hair"], capsys)
    assert status == 130
    assert "Traceback" not in err


def test_programming_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch):
    def fail(_: object) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr("neural_strands.cli.commands.info.Info.run", fail)
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


def shell(line: str) -> tuple[int, str]:
    """Status and standard error of a line of bash, in which $N is the program."""
    environment = {**os.environ, "N": f"{sys.executable} -m neural_strands"}
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], capture_output=True, text=True, check=False, env=environment
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("words", ["--help", "info --help", "--version"])
def test_output_that_nobody_takes_ends_without_a_traceback(words: str):
    assert shell(f"$N {words} >&-") == (0, "")
    assert shell(f"$N {words} | true") in ((141, ""), (0, ""))
    if Path("/dev/full").exists():
        status, told = shell(f"$N {words} > /dev/full")
        assert status == 2
        assert told.startswith("neural-strands: standard output: cannot be written (No space left on device)")
        assert told.count("\n") == 1


STOP_WHILE_LOADING = """
import os, signal, sys, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(60)
"""


@pytest.mark.parametrize("module", ["torch", "tyro"])
def test_ctrl_c_while_modules_load_is_one_sentence(module: str, tmp_path: Path):
    (tmp_path / f"{module}.py").write_text(STOP_WHILE_LOADING)
    status, told = shell(f"PYTHONPATH={tmp_path}:$PYTHONPATH $N score a.hair b.hair")
    assert (status, told) == (130, "neural-strands: stopped; finished parts are kept.\n")


STOP_WHILE_WORKING = """
import os, signal, sys
from neural_strands.cli.commands.info import Info
from neural_strands.cli.main import main
def run(self):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    finally:
        print("kept")
Info.run = run
sys.exit(main(["info", "a.hair"]))
"""


def test_a_request_to_end_is_taken_as_ctrl_c():
    """Batch systems send SIGTERM before they kill. Background jobs of a shell ignore SIGINT and simply end."""
    told = "neural-strands: stopped; finished parts are kept.\n"
    done = subprocess.run([sys.executable, "-c", STOP_WHILE_WORKING], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "kept\n", told)
    ignoring = f"import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n{STOP_WHILE_WORKING}"
    done = subprocess.run([sys.executable, "-c", ignoring], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGTERM, "", "")
