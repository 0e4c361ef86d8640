"""Worker programs: what they are asked, what they answer, and how they fail."""

import json
import sys
import time
from pathlib import Path

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.worker import LONGEST_COMPLAINT, started_worker


def program(folder: Path, body: str) -> Path:
    path = folder / "program.py"
    path.write_text(f"import json, sys\nrequest = json.load(sys.stdin)\n{body}\n", encoding="utf-8")
    return path


def test_a_request_arrives_and_answers_come_back_in_order(tmp_path: Path):
    asked = {"words": ["é", "a\nb", ""]}
    echo = program(tmp_path, "for word in request['words']:\n    print(json.dumps(word), flush=True)")
    with started_worker(None, echo, asked, "json") as worker:
        assert list(worker.answers()) == ['"\\u00e9"\n', '"a\\nb"\n', '""\n']
        assert worker.status() == 0
    assert worker.python == sys.executable


def test_more_output_than_a_pipe_holds_does_not_block(tmp_path: Path):
    loud = program(tmp_path, "print('x' * 10**6)\nprint('y' * 10**6 + '\\nlast', file=sys.stderr)\nsys.exit(4)")
    with started_worker(None, loud, {}, "json") as worker:
        assert worker.status() == 4
        assert worker.last_words() == "last"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("sys.exit(3)", "exit status 3"),
        ("sys.exit('first\\n  the model is damaged')", "  the model is damaged"),
        ("sys.stderr.buffer.write(b'caf\\xe9')", "caf\N{REPLACEMENT CHARACTER}"),
        ("sys.exit('long ' * 1000)", ("long " * 1000)[:LONGEST_COMPLAINT]),
    ],
)
def test_the_last_words_of_one_that_fails(tmp_path: Path, body: str, words: str):
    with started_worker(None, program(tmp_path, body), {}, "json") as worker:
        assert worker.last_words() == words


def test_one_that_aborts_says_why(tmp_path: Path):
    trace = (
        "terminate called\\n  what():  the disk is full\\n*** Aborted at 17 ***\\nPC: @ 0x0 abort\\n    @  0x7f main\\n"
    )
    body = f"sys.stderr.write('{trace}')\nsys.stderr.flush()\nimport os\nos.abort()"
    with started_worker(None, program(tmp_path, body), {}, "json") as worker:
        assert worker.last_words().strip() == "the disk is full"


def test_it_is_killed_where_its_caller_fails(tmp_path: Path):
    began = time.monotonic()
    sleeping = program(tmp_path, "print('here', flush=True)\nimport time\ntime.sleep(60)")

    def interrupted():
        with started_worker(None, sleeping, {}, "json") as worker:
            next(worker.answers())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began < 30


def test_it_sees_neither_this_folder_nor_the_users_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "elsewhere"))
    monkeypatch.chdir(tmp_path)
    with started_worker(None, program(tmp_path, "print(json.dumps(sys.path))"), {}, "json") as worker:
        (answer,) = worker.answers()
    assert str(tmp_path) not in answer
    with started_worker(None, program(tmp_path, "print(json.dumps(sys.path))"), {}, "json", isolated=False) as worker:
        (answer,) = worker.answers()
    assert str(tmp_path / "elsewhere") in json.loads(answer)
    assert str(tmp_path) not in json.loads(answer)


def test_an_interpreter_that_does_not_start_is_one_sentence(tmp_path: Path):
    broken = tmp_path / "python"
    broken.write_bytes(b"")
    message = r"python: expected a Python with bpy, found one that does not start \(Permission denied\); name another"
    with pytest.raises(InputError, match=message), started_worker(broken, broken, {}, "bpy"):
        pass
