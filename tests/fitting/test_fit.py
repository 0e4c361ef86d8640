"""A whole fit of a tiny capture: it learns, resumes to the same bits, and refuses bad input."""

import copy
import itertools
import math
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch
from full_disk import smallest_files
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import held_out_views, training_views
from neural_strands.capture.images import read_pixels
from neural_strands.fitting import first_model
from neural_strands.fitting.checkpoint import load_checkpoint, save_checkpoint
from neural_strands.fitting.config import FitRates
from neural_strands.fitting.first_model import begin, fit_prior
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.schedule import ScheduleConfig, rate_factor
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.model.files import load_hair_model, save_hair_model
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.synthesiser import SynthesiserConfig
from neural_strands.prior.vae import StrandPrior, load_prior, save_prior
from neural_strands.runs import outputs
from neural_strands.runs.outputs import write_outputs, write_preview
from neural_strands.runs.run_folder import RunFolder, weights_digest
from neural_strands.runs.run_log import RunLog

CPU = torch.device("cpu")


@pytest.fixture
def four_threads():
    """Several threads of torch, whatever number tests run with: they may add up in any order."""
    threads = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "ball"
    strands = write_capture(folder)
    capture = Capture.load(folder)
    return capture, find_head(capture, None), true_segments(strands)


def begin_tiny(scene, config):
    capture, head, segments = scene
    data = gather_fit_data(capture, head, segments, config, CPU)
    return begin(data, load_prior(), config), data


def run(state, data, config, until=None):
    figures = []

    def after_step(now, step_figures):
        figures.append(step_figures)
        if until is not None and now.step == until:
            raise StopIteration

    if until is None:
        fit(state, data, config, after_step=after_step)
    else:
        with pytest.raises(StopIteration):
            fit(state, data, config, after_step=after_step)
    return figures


@pytest.mark.usefixtures("shapes_unchecked")
def test_given_strands_stay_while_their_appearance_is_learned(scene):
    schedule = ScheduleConfig(geometry_only=0.0, warmup=5)
    config = tiny_config(steps=60, shape_every=0, schedule=schedule)
    state, data = begin_tiny(scene, config)
    shape, given = state.model.textures.shape.detach().clone(), state.drawn.clone()
    figures = run(state, data, config)
    assert torch.equal(state.model.textures.shape, shape)
    assert torch.equal(state.drawn, given)
    losses = [row["render"] + row["alpha"] for row in figures]
    assert sum(losses[-10:]) < 0.6 * sum(losses[:10])


@pytest.mark.parametrize("far", [True, False], ids=["photographs far apart", "photographs close together"])
@pytest.mark.usefixtures("shapes_unchecked")
def test_once_strands_have_settled_they_stay_and_their_colours_change_with_the_view(scene, monkeypatch, far):
    if not far:
        monkeypatch.setattr(first_model, "CLOSE", math.inf)
    schedule = ScheduleConfig(widest_blur=2.0, geometry_only=0.25, settled_from=0.5, warmup=2)
    config = tiny_config(steps=12, shape_every=1, schedule=schedule)
    state, data = begin_tiny(scene, config)
    run(state, data, config, until=5)
    before = state.model.textures.shape.detach().clone()
    assert not state.model.textures.view.any()
    run(state, data, config, until=6)
    settled, drawn = state.model.textures.shape.detach().clone(), state.drawn.clone()
    assert not torch.equal(settled, before)
    # The rate of the shape has fallen by the time at which strands settle, those of appearance only at the end.
    falls = [group["lr"] / group["rate"] for group in state.optimiser.param_groups]
    assert falls[1:] == pytest.approx([rate_factor(5, 12, schedule)] * (len(falls) - 1))
    assert falls[0] == pytest.approx(rate_factor(5, 12 if far else 6, schedule))
    run(state, data, config, until=10)
    changes = state.model.textures.view.clone()
    figures = run(state, data, config)
    assert torch.equal(state.model.textures.view, changes) == far
    assert torch.equal(state.model.textures.shape, settled) == (not far)
    assert torch.equal(state.drawn, drawn) == (not far)
    assert bool(state.model.textures.view.any()) == (not far)
    assert any("surface" in row for row in figures) == far


@pytest.mark.parametrize("amplitude", [-30.0, 5.0])
def test_the_perceptual_loss_sees_grain_and_the_squared_error_does_not(scene, amplitude):
    schedule = ScheduleConfig(geometry_only=0.0, perceptual_from=0.0)
    config = tiny_config(steps=1, shape_every=0, schedule=schedule, initialise="mean")
    rows, pictures = [], []

    def perceptual(image, photograph):
        pictures.append(image.detach())
        return (image - photograph).abs().mean()

    for level in (-30.0, amplitude):
        state, data = begin_tiny(scene, config)
        with torch.no_grad():
            state.model.grain.level.fill_(level)
        before = state.model.grain.amplitudes().detach()
        fit(state, data, config, perceptual, after_step=lambda _, figures: rows.append(figures))
        assert torch.equal(state.model.grain.amplitudes(), before) == (level == -30.0)
    none, some = rows
    assert some["render"] == none["render"]
    assert (some["perceptual"] > none["perceptual"]) == (amplitude > 0)
    assert torch.equal(*pictures) == (amplitude < 0)


def test_without_a_perceptual_loss_the_strength_of_grain_is_not_learned(scene):
    config = tiny_config(steps=3, shape_every=0, schedule=ScheduleConfig(geometry_only=0.0), initialise="mean")
    state, data = begin_tiny(scene, config)
    before = state.model.grain.amplitudes().detach()
    fit(state, data, config)
    assert torch.equal(state.model.grain.amplitudes(), before)


def test_every_fifth_view_is_held_out(scene):
    capture, _, _ = scene
    config = tiny_config()
    assert held_out_views(len(capture), config.hold_out_every) == [4]
    assert training_views(len(capture), config.hold_out_every) == [0, 1, 2, 3, 5]
    assert held_out_views(len(capture), 0) == []


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_fit_brings_strands_from_anywhere_to_the_segments(scene):
    config = tiny_config(steps=60, initialise="mean", rates=FitRates(shape=3e-2))
    config = replace(config, schedule=replace(config.schedule, geometry_only=1.0))
    state, data = begin_tiny(scene, config)
    coverage = [row["coverage"] for row in run(state, data, config)]
    assert sum(coverage[-5:]) < 0.8 * sum(coverage[:5])


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_fit_shows_the_photographs_and_stays_out_of_the_head(scene):
    config = tiny_config(steps=60, strands=400)
    state, data = begin_tiny(scene, config)
    run(state, data, config)
    strands, error, flat = Strands(state.drawn, root_uv=state.model.root_uv), 0.0, 0.0
    with torch.no_grad():
        for target in data.views:
            rendered = state.model.render(strands, target.camera).rgb
            error += float((rendered - target.image).square().mean())
            flat += float((target.image - target.image.mean(dim=(0, 1))).square().mean())
    assert error < 0.5 * flat
    depth = signed_distance(state.drawn[:, 6:].reshape(-1, 3), data.head.mesh).distance
    assert (depth < -0.002).float().mean() < 0.02
    torch.testing.assert_close(state.drawn[:, 0], state.model.root_position, atol=1e-5, rtol=0)


@pytest.mark.usefixtures("four_threads")
def test_a_resumed_fit_ends_in_the_same_bits(scene, tmp_path):
    config, path = tiny_config(), tmp_path / "checkpoint.pt"
    whole, data = begin_tiny(scene, config)
    fit(whole, data, config, after_step=lambda now, _: save_checkpoint(now, path) if now.step == 8 else None)
    second, data = begin_tiny(scene, config)
    load_checkpoint(second, path)
    assert second.step == 8
    run(second, data, config)
    for (name, ours), theirs in zip(second.model.state_dict().items(), whole.model.state_dict().values(), strict=True):
        assert torch.equal(ours, theirs), name
    assert torch.equal(second.drawn, whole.drawn)


@pytest.fixture(scope="module")
def whole(scene):
    """A fit that nothing stopped."""
    config = tiny_config(initialise="mean")
    state, data = begin_tiny(scene, config)
    run(state, data, config)
    return state


@pytest.mark.parametrize("moment", ["before", "after"])
def test_an_interrupted_fit_goes_on_to_the_same_bits(scene, whole, tmp_path, monkeypatch, moment):
    """Ctrl-C just before or just after the optimiser's seventh update: the step is finished, and none is repeated."""
    config = tiny_config(initialise="mean")
    first, data = begin_tiny(scene, config)
    update, calls = first.optimiser.step, itertools.count(1)

    def interrupted():
        now = next(calls) == 7
        if now and moment == "before":
            signal.raise_signal(signal.SIGINT)
        update()
        if now and moment == "after":
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(first.optimiser, "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(first, data, config)
    assert first.step == 7
    save_checkpoint(first, tmp_path / "checkpoint.pt")
    second, data = begin_tiny(scene, config)
    load_checkpoint(second, tmp_path / "checkpoint.pt")
    run(second, data, config)
    for (name, ours), theirs in zip(second.model.state_dict().items(), whole.model.state_dict().values(), strict=True):
        assert torch.equal(ours, theirs), name
    assert torch.equal(second.drawn, whole.drawn)


GARBAGE = {
    "a list": lambda content: content.update(remembered=[1, 2]),
    "nothing": lambda content: content.update(drawn=None),
    "no moments": lambda content: content["optimiser"].update(state=None),
    "no moment": lambda content: content["optimiser"]["state"][0].update(exp_avg=None),
    "no groups": lambda content: content["optimiser"].update(param_groups=5),
    "no rate": lambda content: content["optimiser"]["param_groups"][0].update(rate="fast"),
    "another size": lambda content: content.update(first=torch.zeros(3, 2, 3)),
    "no weights": lambda content: content["model"].clear(),
    "no step": lambda content: content.pop("step"),
    "a negative step": lambda content: content.update(step=-1),
    "a text": lambda content: content.update(step="8"),
}


@pytest.fixture(scope="module")
def begun(scene):
    """A fit after its first step."""
    config = tiny_config(initialise="mean")
    state, data = begin_tiny(scene, config)
    run(state, data, config, until=1)
    return state


@pytest.mark.parametrize("name", sorted(GARBAGE))
def test_garbage_in_a_checkpoint_is_one_sentence(begun, tmp_path, name):
    state, path = begun, tmp_path / "checkpoint.pt"
    save_checkpoint(state, path)
    content = torch.load(path, weights_only=True)
    GARBAGE[name](content)
    torch.save(content, path)
    with pytest.raises(InputError, match=r"checkpoint\.pt: expected this fit's complete checkpoint, found ") as caught:
        load_checkpoint(state, path)
    assert str(caught.value).isprintable()


def test_broken_checkpoints_are_refused_in_one_sentence(scene, tmp_path):
    config = tiny_config(initialise="mean")
    state, data = begin_tiny(scene, config)
    path = tmp_path / "checkpoint.pt"
    save_checkpoint(state, path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match="whole"):
        load_checkpoint(state, path)
    run(state, data, config)
    save_checkpoint(state, path)
    whole = torch.load(path, weights_only=True)
    parts = {
        "textures.appearance": lambda content: content["model"]["textures.appearance"],
        "the optimiser's exp_avg": lambda content: content["optimiser"]["state"][0]["exp_avg"],
        "remembered": lambda content: content["remembered"],
    }
    for name, part in parts.items():
        content = copy.deepcopy(whole)
        part(content).view(-1)[-1] = float("nan")
        torch.save(content, path)
        with pytest.raises(InputError, match=f"NaN in {name}"):
            load_checkpoint(state, path)
    torch.save(whole, path)
    with torch.no_grad():
        state.model.textures.appearance[0, 0, 0] = float("nan")
    with pytest.raises(InputError, match=r"diverged: NaN in textures\.appearance after step 12"):
        save_checkpoint(state, path)
    load_checkpoint(state, path)
    assert state.model.textures.appearance.isfinite().all()


def test_the_preview_of_a_large_photograph_is_small(scene, tmp_path, monkeypatch):
    config = tiny_config(initialise="mean")
    state, data = begin_tiny(scene, config)
    view = data.views[0]
    for most, sides in ((40, (40, 40)), (10_000, (view.camera.width, view.camera.height))):
        monkeypatch.setattr(outputs, "PREVIEW_SIDE", most)
        write_preview(tmp_path / "a.png", state.model, state.drawn, data)
        picture = read_pixels(tmp_path / "a.png")
        assert picture.shape[:2] == (sides[1], 2 * sides[0])
        photograph = torch.from_numpy(picture[:, sides[0] :].astype(np.float32)) / 255
        assert float((photograph.mean(dim=(0, 1)) - view.image.mean(dim=(0, 1))).abs().max()) < 0.01


def test_where_the_disk_is_full_what_was_there_stays(scene, tmp_path):
    config = tiny_config(initialise="mean")
    state, data = begin_tiny(scene, config)
    folder = RunFolder(tmp_path)
    save_checkpoint(state, folder.checkpoint)
    write_outputs(folder, state.model, data, {})
    write_preview(folder.preview, state.model, state.drawn, data)
    log = RunLog(folder.log, 0)
    log.add({"step": 1.0})
    log.flush()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert len(before) == 7
    log.add({"text": 1.0} | {f"figure {k}": 0.0 for k in range(100)})
    writes = (
        lambda: save_checkpoint(state, folder.checkpoint),
        lambda: write_outputs(folder, state.model, data, {}),
        lambda: write_groom(folder.groom, Groom.from_strands(Strands(state.drawn))),
        lambda: write_preview(folder.preview, state.model, state.drawn, data),
        log.flush,
    )
    with smallest_files(1000):
        for write in writes:
            with pytest.raises(InputError, match=r"cannot be written \(.*File too large\)"):
                write()
    log_path = folder.log
    assert log_path.read_bytes().startswith(before.pop(log_path))
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file() and path != log_path} == before


@pytest.mark.parametrize(
    "changed", [{"synthesiser": SynthesiserConfig(output="position")}, {"modulator": "mlp"}], ids=["position", "mlp"]
)
def test_a_fit_takes_another_prior_and_its_model_loads(scene, tmp_path, changed):
    save_prior(StrandPrior(GeneratorConfig(**changed)), tmp_path / "prior.safetensors", {})
    prior = fit_prior(tmp_path / "prior.safetensors", CPU)
    assert weights_digest(prior) != weights_digest(fit_prior(None, CPU))
    capture, head, segments = scene
    config = tiny_config(steps=3, initialise="mean")
    data = gather_fit_data(capture, head, segments, config, CPU)
    state = begin(data, prior, config)
    run(state, data, config)
    save_hair_model(state.model, tmp_path / "model")
    with torch.no_grad():
        strands = load_hair_model(tmp_path / "model").decode().points
    assert torch.equal(strands, state.model.decode().points)
    torch.testing.assert_close(strands[:, 0], state.model.root_position, atol=1e-5, rtol=0)


def test_without_masks_the_hair_volume_comes_from_the_segments(tmp_path):
    strands = write_capture(tmp_path / "plain", with_masks=False)
    capture = Capture.load(tmp_path / "plain")
    config = tiny_config(steps=2)
    data = gather_fit_data(capture, find_head(capture, None), true_segments(strands), config, CPU)
    state = begin(data, load_prior(), config)
    tips = state.drawn[:, -1]
    assert torch.isfinite(tips).all()
    assert float(torch.cdist(tips, strands.reshape(-1, 3)).amin(dim=1).median()) < 0.01


def test_inputs_that_no_fit_can_come_of_are_refused(scene):
    capture, head, segments = scene
    config = tiny_config()
    with pytest.raises(InputError, match="at least 3 training views, found 2"):
        gather_fit_data(capture.subset([0, 1]), head, segments, config, CPU)
    with pytest.raises(InputError, match="segment points"):
        gather_fit_data(capture, head, segments.select(torch.arange(20)), config, CPU)
    with pytest.raises(InputError, match="align or scale"):
        gather_fit_data(
            capture, head.transformed(1.0, torch.eye(3), torch.tensor([2.0, 0.0, 0.0])), segments, config, CPU
        )
