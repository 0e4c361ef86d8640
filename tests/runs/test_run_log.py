"""The log of a run: what was added is read back, and if a killed process leaves half a line, only that is lost."""

import logging
import math

import pytest

from neural_strands.runs.run_log import RunLog, read_log, read_losses


@pytest.fixture
def path(tmp_path):
    log = RunLog(tmp_path / "log.jsonl", 0)
    for step in range(1, 4):
        log.add({"step": float(step), "seconds": 0.5, "render": 0.25 * step})
    log.flush()
    return tmp_path / "log.jsonl"


def test_what_was_added_comes_back(path, caplog):
    assert [row["render"] for row in read_log(path)] == [0.25, 0.5, 0.75]
    assert read_losses(path) == {"render": [(1.0, 0.25), (2.0, 0.5), (3.0, 0.75)]}
    assert read_log(path.parent / "absent.jsonl") == []
    assert caplog.text == ""


@pytest.mark.parametrize(
    "torn",
    [b'{"step": 4.0, "rend', b"\xff\xfe", b"[1, 2]", b"[" * 100_000, b'{"render": 1.0}', b'{"step": "4"}', b"NaN"],
)
def test_a_torn_line_is_left_out(path, caplog, torn):
    path.write_bytes(path.read_bytes() + torn)
    with caplog.at_level(logging.WARNING):
        assert [row["step"] for row in read_log(path)] == [1.0, 2.0, 3.0]
    assert "1 of 4 lines cannot be read" in caplog.text
    RunLog(path, 2)
    assert [row["step"] for row in read_log(path)] == [1.0, 2.0]


def test_figures_that_are_not_numbers(path):
    path.write_text('{"step": 1.0, "render": NaN, "kind": "text"}\n')
    (row,) = read_log(path)
    assert math.isnan(row.pop("render"))
    assert row == {"step": 1.0}
