"""Fit, stereo and prior with every tensor on another device: nothing is left behind, and the numbers are the CPU's.

The emulated device computes as the CPU does. A real one adds up in another order, so its bounds are wider.
"""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from emulated_device import waits
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.cli.main import main
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.fitting.checkpoint import load_checkpoint, save_checkpoint
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.foundation.progress import Feedback
from neural_strands.lmvs import view_cache as work_module
from neural_strands.lmvs.files import save_segments
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.vae import load_prior
from neural_strands.prior_training import curve_stream
from neural_strands.prior_training import train_prior as prior_module
from neural_strands.prior_training.config import TrainPriorConfig
from neural_strands.prior_training.train_prior import train_prior
from neural_strands.runs.evaluate import evaluate_run, open_run
from neural_strands.runs.run_fit import FitRequest, run_fit

CPU = torch.device("cpu")
SHORT = tiny_config(steps=4, initialise="mean")
EXACT = replace(SHORT, model=replace(SHORT.model, mixed_precision=False))


@pytest.fixture(params=["emulated", pytest.param("cuda", marks=pytest.mark.gpu)])
def accelerator(request):
    return request.getfixturevalue(request.param)


def is_real(request) -> bool:
    return request.node.callspec.params["accelerator"] == "cuda"


def on_device(tensor: torch.Tensor) -> bool:
    return tensor.device.type == "cuda"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "ball"
    write_capture(folder)
    return folder


def fitted(folder: Path, device: torch.device, config):
    capture = Capture.load(folder)
    head = find_head(capture, None)
    data = gather_fit_data(capture, head, true_segments(capture.ground_truth.points), config, device)
    state = begin(data, load_prior(None, device), config)
    rows = []
    fit(state, data, config, structural_loss, after_step=lambda _, row: rows.append(row))
    return state, rows


@pytest.fixture(scope="module")
def exact_on_cpu(folder):
    return fitted(folder, CPU, EXACT)


def test_a_fit_gives_the_numbers_of_the_cpu(folder, exact_on_cpu, tmp_path, accelerator, request):
    there, rows = fitted(folder, accelerator, EXACT)
    close, moved = (2e-3, 1e-4) if is_real(request) else (1e-4, 1e-5)
    here, expected = exact_on_cpu
    for row, wanted in zip(rows, expected, strict=True):
        assert {k: v for k, v in row.items() if k != "seconds"} == pytest.approx(
            {k: v for k, v in wanted.items() if k != "seconds"}, rel=close, abs=1e-6
        )
    ours = {**dict(there.model.named_parameters()), **dict(there.model.named_buffers())}
    ours |= {"remembered": there.remembered, "drawn": there.drawn}
    assert [name for name, value in ours.items() if not on_device(value)] == []
    torch.testing.assert_close(there.drawn.cpu(), here.drawn, atol=moved, rtol=0)
    save_checkpoint(there, tmp_path / "checkpoint.pt")
    before = there.drawn.clone()
    load_checkpoint(there, tmp_path / "checkpoint.pt")
    assert on_device(there.drawn)
    counts, moments = zip(*((kept["step"], kept["exp_avg"]) for kept in there.optimiser.state.values()), strict=True)
    assert not any(map(on_device, counts))
    assert all(map(on_device, moments))
    assert torch.equal(there.drawn, before)


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_fit_in_bfloat16_stays_near_it(folder, exact_on_cpu, accelerator):
    _, rough = fitted(folder, accelerator, SHORT)
    _, exact = exact_on_cpu
    assert rough[-1]["render"] != exact[-1]["render"]
    assert rough[-1]["render"] == pytest.approx(exact[-1]["render"], rel=0.05)


def test_a_step_reads_its_figures_once(folder, emulated):
    config = replace(EXACT, steps=1, schedule=replace(EXACT.schedule, geometry_only=1.0))
    capture = Capture.load(folder)
    segments = true_segments(capture.ground_truth.points)
    data = gather_fit_data(capture, find_head(capture, None), segments, config, emulated)
    state = begin(data, load_prior(None, emulated), config)
    reads = []
    for told in (None, None, lambda *_: None):
        state.step = 0
        waits.clear()
        fit(state, data, config, after_step=told)
        reads.append(waits["tolist"])
        assert waits["aten._local_scalar_dense.default"] == 0
    # The first step reads what stays the same.
    assert reads[2] == reads[1] + 1


@pytest.mark.slow(seconds=50)
def test_a_whole_run_from_photographs_to_scores(folder, tmp_path, accelerator):
    config = replace(SHORT, initialise="flow")
    save_segments(tmp_path / "segments.npz", true_segments(Capture.load(folder).ground_truth.points))
    request = FitRequest(folder, tmp_path / "run", segments=tmp_path / "segments.npz")
    state = run_fit(request, config, accelerator, Feedback())
    assert on_device(state.drawn)
    result = evaluate_run(open_run(tmp_path / "run", accelerator), accelerator)
    assert result.ours[-1].unsigned.as_dict()
    hair = result.views[0].quality.hair
    assert hair is not None
    assert hair.psnr > 0
    frames = ["--out", str(tmp_path / "frames"), "--turntable", "2", "--size", "32", "32"]
    assert main(["render", str(tmp_path / "run" / "model"), *frames, "--device", "cuda"]) == 0
    assert len(list((tmp_path / "frames").glob("*.png"))) == 2
    assert main(["score", str(tmp_path / "run" / "groom.npz"), str(folder), "--device", "cuda"]) == 0


def test_stereo_gives_the_lines_of_the_cpu(accelerator, monkeypatch, tmp_path, request):
    # Features and lines that do not fit into memory come back from disk to the device.
    monkeypatch.setattr(work_module, "KEPT", 2)
    write_capture(tmp_path / "ball", views=4)
    capture = Capture.load(tmp_path / "ball")
    head = find_head(capture, None).mesh
    found = []
    for device in (accelerator, CPU):
        views = capture.views_on(device)
        found.append(reconstruct(views, head.to(device), LmvsConfig(), torch.Generator().manual_seed(0)))
    there, here = found
    assert on_device(there.points)
    assert len(here) > 0
    if is_real(request):
        # Of lines that fit almost as well, rounding chooses, and the next ones begin with it.
        truth = capture.ground_truth.points.reshape(-1, 3)
        near = [(torch.cdist(found.points.cpu(), truth).amin(1) < 2e-3).float().mean() for found in (there, here)]
        assert len(there) == pytest.approx(len(here), rel=0.1)
        assert near[0] == pytest.approx(near[1], abs=0.05)
        return
    assert torch.equal(there.points.cpu(), here.points)
    assert torch.equal(there.segment_id.cpu(), here.segment_id)


def test_training_of_the_prior_gives_the_weights_of_the_cpu(accelerator, monkeypatch, tmp_path, request):
    monkeypatch.setattr(curve_stream, "CHUNK", 64)
    monkeypatch.setattr(prior_module, "HELD_OUT", 32)
    config = TrainPriorConfig(
        steps=3,
        sine_steps=2,
        start_curves=200,
        batch=16,
        steps_a_chunk=4,
        checkpoint_seconds=0.0,
        generator=GeneratorConfig(layers=2, hidden=16),
    )
    there = train_prior(tmp_path / "there.safetensors", config, seed=1, device=accelerator)
    here = train_prior(tmp_path / "here.safetensors", config, seed=1)
    assert all(on_device(value) for value in there.state_dict().values())
    # Adam divides each gradient by its size, so rounding alone moves weights whose gradient is next to nothing; and
    # eigenvectors, from which some of the first weights are made, may have other signs.
    loose, signed = (10, ("linear.", "smooth_mix")) if is_real(request) else (1, ())
    for name, value in here.state_dict().items():
        if any(part in name for part in signed):
            continue
        found = there.state_dict()[name].cpu()
        torch.testing.assert_close(found, value, atol=1e-4 * loose, rtol=1e-3 * loose, msg=name)
