"""A page that follows a run: its newest state, its curves, and edits that stay."""

import json
import os
import shutil

import pytest
import torch

from neural_strands.editing.settings import Haircut
from neural_strands.fitting.checkpoint import load_checkpoint_model
from neural_strands.fitting.first_model import fit_prior
from neural_strands.foundation.errors import InputError
from neural_strands.model.files import load_hair_model
from neural_strands.runs.newest_model import StateFile, load_newest_model, newest_state
from neural_strands.runs.run_folder import RunFolder, read_description
from neural_strands.viewer.layers import HEAD
from neural_strands.viewer.serve import ServedPage
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

CPU = torch.device("cpu")


@pytest.fixture
def run(tiny_run, tmp_path):
    """A copy of the run, beside a copy of its capture."""
    shutil.copytree(tiny_run.parent / "ball", tmp_path / "ball")
    shutil.copytree(tiny_run, tmp_path / "run")
    return RunFolder(tmp_path / "run")


@pytest.fixture
def serve():
    server, pages = start_server(LOOPBACK, 0), []

    def make(path):
        pages.append(ServedPage(server, path, CPU))
        return pages[-1]

    yield make
    stop_server(server)
    for page in pages:
        page.close()


def touch(path, seconds):
    os.utime(path, (seconds, seconds))


def test_a_checkpoint_holds_the_model_that_the_run_ends_with(run):
    written = load_hair_model(run.model).state_dict()
    read = load_newest_model(run, StateFile(run.checkpoint, 0), CPU).state_dict()
    assert written.keys() == read.keys()
    # Only when it writes its results does a fit fill in the appearance that no photograph shows.
    for name in written.keys() - {"textures.appearance", "textures.elsewhere"}:
        assert torch.equal(written[name], read[name]), name


def test_the_distance_to_the_head_is_sampled_before_an_edit_needs_it(run, serve, monkeypatch):
    monkeypatch.setattr("neural_strands.viewer.serve.PREPARE_SECONDS", 0.0)
    served = serve(run.path)
    served._preparing.join(60)
    assert "grid" in vars(served.page.scene.fitted.body)


def test_the_newest_state_is_the_one_written_last(run):
    touch(run.checkpoint, 1000)
    touch(run.model / "model.safetensors", 2000)
    assert newest_state(run).path == run.model / "model.safetensors"
    touch(run.checkpoint, 3000)
    assert newest_state(run).path == run.checkpoint
    run.checkpoint.unlink()
    shutil.rmtree(run.model)
    assert newest_state(run) is None


def test_a_damaged_checkpoint_is_one_sentence(run):
    torch.save({"model": {"root_position": torch.zeros(3, 3)}}, run.checkpoint)
    config = read_description(run).config.model
    with pytest.raises(InputError, match="expected a complete hair model"):
        load_checkpoint_model(run.checkpoint, config, fit_prior(None, CPU).generator)
    torch.save([1, 2], run.checkpoint)
    with pytest.raises(InputError, match="found no hair model"):
        load_checkpoint_model(run.checkpoint, config, fit_prior(None, CPU).generator)


def test_a_page_shows_each_new_state_with_the_edits_made_so_far(run, serve):
    touch(run.checkpoint, 1000)
    shutil.move(run.model, run.path / "later")
    served = serve(run.path)
    assert not served.refresh()
    served.page.edit(lambda history: history.with_edit(Haircut(length=0.03, uneven=0.0)))
    first = served.page.scene
    shutil.move(run.path / "later", run.model)
    touch(run.model / "model.safetensors", 2000)
    assert served.refresh()
    assert served.page.scene is not first
    assert served.page.scene.edits == (Haircut(length=0.03, uneven=0.0),)
    torch.testing.assert_close(served.page.scene.strands.points, first.strands.points)
    assert not served.refresh()


def test_hair_appears_with_the_first_state(run, serve):
    hidden = run.path / "hidden"
    hidden.mkdir()
    shutil.move(run.checkpoint, hidden / "checkpoint.pt")
    shutil.move(run.model, hidden / "model")
    served = serve(run.path)
    assert served.page.scene.renderer is None
    assert served.page.scene.photographs is not None
    # Until there is hair, the head is shown.
    assert served.page.look.objects == {HEAD}
    assert served.page.server.scene.get_handle_by_name(HEAD) is not None
    shutil.move(hidden / "checkpoint.pt", run.checkpoint)
    assert served.refresh()
    assert served.page.scene.renderer is not None
    assert served.page.look.objects == set()
    assert served.page.server.scene.get_handle_by_name(HEAD) is None


def test_a_broken_state_leaves_what_was_shown(run, serve, caplog):
    served = serve(run.path)
    before = served.page.scene
    run.checkpoint.write_bytes(b"cut off")
    touch(run.checkpoint, 4_000_000_000)
    assert not served.refresh()
    assert served.page.scene is before
    assert "checkpoint.pt" in caplog.text


def test_the_curves_grow_with_the_log(run, serve):
    served = serve(run.path)
    panel = served._tabs._fit
    before = len(panel._chart.data[0])
    with run.log.open("a") as file:
        for step in range(21, 31):
            file.write(json.dumps({"step": float(step), "seconds": 0.1, "render": 0.01}) + "\n")
    served.refresh()
    assert "Step 30 of 20" in panel._done.content
    assert panel._choice.value == "colour error"
    assert len(panel._chart.data[0]) == before + 10
    assert float(panel._chart.data[1][-1]) == pytest.approx(0.01)


def test_a_haircut_that_leaves_nothing_changes_nothing(run, serve):
    served = serve(run.path)
    before = served.page.scene, served.page.history
    with pytest.raises(InputError, match="expected hair to remain"):
        served.page.edit(lambda history: history.with_edit(Haircut(fraction=1.0)))
    assert (served.page.scene, served.page.history) == before
