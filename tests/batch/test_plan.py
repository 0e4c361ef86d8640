"""The order of stages, and what failures and deaths do to it; the table and the page that show it."""

import io
import itertools

import cv2
import numpy as np
import pytest
from html_page import ReportPage
from rich.console import Console

from neural_strands.batch.plan import Plan
from neural_strands.batch.records import StageRecord, read_records, write_record, write_subject
from neural_strands.batch.storage import Store
from neural_strands.batch.subjects import STAGES, Subject
from neural_strands.batch.summary import write_summary
from neural_strands.batch.table import shown, table
from neural_strands.batch.task import Outcome
from neural_strands.foundation.errors import InputError


def record(stage, **figures):
    return StageRecord(stage, 3.0, 2 * 10**9, "node-1", figures)


def begun(retries=1):
    return Plan([Subject("bob", "photos", prepared=False), Subject("eve", "ball", prepared=True)], retries)


def hand_out(plan):
    row = plan.next()
    row.running = True
    return row.subject.name, row.stage


def test_the_furthest_subject_comes_first():
    plan, order = begun(), []
    while (row := plan.next()) is not None:
        order.append((row.subject.name, row.stage))
        plan.ended(row.subject.name, Outcome(record(row.stage)))
    assert order == [("eve", stage) for stage in STAGES[1:]] + [("bob", stage) for stage in STAGES]
    assert plan.over
    assert plan.failures == {}


def test_a_running_subject_is_not_handed_out_twice():
    plan = begun()
    assert {hand_out(plan), hand_out(plan)} == {("bob", "prepare"), ("eve", "lmvs")}
    assert plan.next() is None
    assert not plan.over


def test_a_failure_ends_its_subject_alone():
    plan = begun()
    plan.ended("eve", Outcome(failure="no hair."))
    assert plan.failures == {"eve": "lmvs: no hair."}
    assert hand_out(plan) == ("bob", "prepare")


def test_a_death_is_forgiven_so_many_times_for_each_stage():
    plan = begun(retries=1)
    plan.died("eve", "node gone")
    assert plan.rows["eve"].waits
    plan.ended("eve", Outcome(record("lmvs")))
    plan.died("eve", "node gone")
    assert plan.rows["eve"].waits
    plan.died("eve", "out of memory")
    assert plan.failures == {"eve": "fit: its worker died 2 times, the last time because: out of memory."}
    assert plan.rows["eve"].losses == 3


def test_the_table_tells_every_state():
    plan = begun()
    plan.known("eve", {"lmvs": record("lmvs")})
    plan.rows["eve"].running = True
    plan.rows["eve"].news = "fitting: 3 of 9"
    plan.failed("bob", "prepare: no [red] photographs.")
    printed = io.StringIO()
    console = Console(width=120, file=printed)
    console.print(table(plan))
    lines = [line for line in printed.getvalue().splitlines() if "bob" in line or "eve" in line]
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines]
    assert cells == [
        ["eve", "given", "3 s", "runs", "waits", "fitting: 3 of 9"],
        ["bob", "failed", "-", "-", "-", "prepare: no [red] photographs."],
    ]


def test_without_a_terminal_each_change_is_told_once(capsys):
    plan = begun()
    with shown(terminal=False) as show:
        for change in (
            lambda: None,
            lambda: plan.ended("eve", Outcome(record("lmvs"))),
            lambda: plan.died("eve", "node gone"),
            lambda: plan.ended("bob", Outcome(failure="no photographs.")),
        ):
            change()
            show(plan)
            show(plan)
    assert capsys.readouterr().err.splitlines() == [
        "eve: lmvs done in 3 s",
        "eve: fit: lost (node gone), tried again",
        "bob: prepare: no photographs.",
    ]


def test_the_page_shows_figures_pictures_and_failures(tmp_path):
    plan = begun()
    figures = {"held_out_views.psnr": 25.5, "held_out_views.ssim": 0.5}
    plan.known("eve", {stage: record(stage, **(figures if stage == "evaluate" else {})) for stage in STAGES[1:]})
    plan.failed("bob", "prepare: <no> photographs.")
    picture = np.random.default_rng(0).integers(0, 255, (4, 12, 3), np.uint8)
    Store(str(tmp_path)).child("eve").write("thumbnail.png", cv2.imencode(".png", picture)[1].tobytes())
    write_summary(Store(str(tmp_path)), plan)
    page = ReportPage((tmp_path / "index.html").read_text())
    assert page.tables["Failed"][1:] == [["bob", "prepare: <no> photographs."]]
    assert page.tables["Figures"][1:] == [["bob", *"-------"], ["eve", "25.500", "0.500", *"-----"]]
    assert page.tables["Time, memory and node of each stage"][2][2] == "3 s, 2.0 GB, node-1"
    assert "eve/run/report/index.html" in page.addresses
    ((name, shown_picture),) = page.pictures
    assert name == "eve"
    np.testing.assert_array_equal(shown_picture, picture[..., ::-1])


def test_records_are_read_back_up_to_the_first_that_is_missing(tmp_path):
    store, subject = Store(str(tmp_path)).child("eve"), Subject("eve", "ball", prepared=True)
    assert read_records(store, subject) == {}
    write_subject(store, subject)
    for stage in ("lmvs", "evaluate"):
        write_record(store, record(stage, views=3.0))
    assert read_records(store, subject) == {"lmvs": record("lmvs", views=3.0)}


def test_other_settings_than_those_of_the_records_are_refused(tmp_path):
    store, subject = Store(str(tmp_path)).child("eve"), Subject("eve", "ball", prepared=True)
    write_subject(store, subject)
    other = Subject("eve", "elsewhere", prepared=True)
    assert read_records(store, other) == {}
    write_record(store, record("lmvs"))
    with pytest.raises(InputError, match="begun with another source than the subjects file has now"):
        read_records(store, other)


def test_damaged_records_are_refused(tmp_path):
    store, subject = Store(str(tmp_path)), Subject("eve", "ball", prepared=True)
    write_subject(store, subject)
    write_record(store, record("lmvs"))
    for name, harm in itertools.product(("subject.json", "stages/lmvs.json"), (b"{", b"[]", b'{"format": 9}')):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(harm)
        with pytest.raises(InputError, match=name):
            read_records(store, subject)
        (tmp_path / name).write_bytes(whole)
