"""Variants of the ablations: what each of them changes, hair that hangs, and runs on a tiny capture."""

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch
from tiny_capture import RADIUS, tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.config import preset
from neural_strands.geometry.strands import lengths
from neural_strands.lmvs.files import load_segments, save_segments

CHANGES = {
    "full": {},
    "no LMVS": {"weights.geometry": 0.0, "initial.curls.find": False},
    "no coarse-to-fine, no root-to-tip": {"schedule.widest_blur": 0.0},
    "geometry alone": {"weights.shape_from_image": 0.0},
    "geometry alone, no streaks": {"weights.shape_from_image": 0.0, "weights.streaks": 0.0},
    "positions": {},
    "random networks": {"networks": "random"},
    "strided UNet": {"networks": "random", "model.unet.alias_free": False},
    "no UNet": {"model.unet.corrects": False},
    "no alpha loss": {"weights.alpha": 0.0},
}
"""What each variant of the preset `fast` changes, by the names of the settings."""


@pytest.fixture(scope="module")
def variants(benchmark_module):
    return benchmark_module("quality", "ablation_variants")


@pytest.fixture(scope="module")
def ablations(benchmark_module):
    return benchmark_module("quality", "ablations")


@pytest.fixture(scope="module")
def hanging(benchmark_module):
    return benchmark_module("quality", "hanging_hair")


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("ablations") / "ball"
    write_capture(folder, views=10)
    return Capture.load(folder)


def flat(settings: dict, before: str = "") -> dict:
    """Settings by their full names."""
    found = {}
    for name, value in settings.items():
        found |= flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return found


def test_every_variant_changes_what_it_is_named_after(variants):
    base = preset("fast")
    made = variants.variants(base, Path("positions.safetensors"))
    whole = flat(asdict(base))
    for name, changes in CHANGES.items():
        found = flat(asdict(made[name].config))
        assert {key: value for key, value in found.items() if value != whole[key]} == changes, name
    assert [name for name, variant in made.items() if not variant.stereo] == ["no LMVS"]
    assert [name for name, variant in made.items() if variant.prior is not None] == ["positions"]
    assert made.keys() - CHANGES.keys() == {"mean start", "mean start, no coarse-to-fine, no root-to-tip"}
    assert "positions" not in variants.variants(base, None)


@pytest.mark.parametrize(
    ("name", "steps", "crop", "side"),
    [
        ("fast", 300, None, 128),
        ("fast", 2499, None, 128),
        ("fast", 2500, None, 160),
        ("fast", 5000, None, 160),
        ("fast", 2500, 96, 96),
        ("demo", 400, None, 128),
        ("paper", 300, None, 128),
        ("paper", 12_000, None, 1024),
    ],
)
def test_a_fit_with_all_its_steps_sees_regions_of_the_presets_size(variants, name, steps, crop, side):
    config = variants.full_config(name, steps, crop, 7)
    assert (config.crop, config.steps, config.seed) == (side, steps, 7)
    assert replace(config, crop=preset(name).crop, steps=preset(name).steps, seed=0) == preset(name)


def test_hair_hangs_within_the_masks_whatever_the_photographs_show(hanging, capture):
    """On a ball, hair that hangs runs down its meridians, as the combed hair of the masks does."""
    views = capture.views_on()

    def blind(index, part):
        assert part != "image"
        return views.read(index, part)

    found = hanging.hanging_segments(replace(views, read=blind), find_head(capture, None), tiny_config())
    assert found.segment_count == 200
    assert bool((found.confidence == 1).all())
    assert float(lengths(found.points.view(200, -1, 3)).median()) > 0.03
    radius = found.points.norm(dim=1)
    # The combed hair is at most 13 mm thick; a pixel of the masks is 4 mm wide, as is a voxel.
    assert float(radius.quantile(0.01)) > RADIUS - 0.003
    assert float(radius.max()) < RADIUS + 0.02
    outward = found.points / radius[:, None]
    down = torch.tensor([0.0, -1.0, 0.0])
    meridian = torch.nn.functional.normalize(down - (outward @ down)[:, None] * outward, dim=1)
    # At the top of the ball every direction leads down.
    cosine = (found.directions * meridian).sum(dim=1)[outward[:, 1] < 0.9]
    assert float(cosine.median()) > 0.95
    assert bool((cosine > 0).all())


@pytest.mark.slow
def test_variants_run_once_and_their_table_has_means_over_seeds(ablations, capture, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    monkeypatch.setattr(ablations, "full_config", lambda name, steps, crop, seed: tiny_config(steps=steps, seed=seed))
    out, truth = tmp_path / "out", capture.ground_truth
    assert truth is not None
    (out / "seed_0").mkdir(parents=True)
    save_segments(out / "seed_0" / "segments.npz", true_segments(truth.points))
    asked = ablations.Arguments(capture.folder, out, only=("no LMVS", "no UNet"), steps=4)
    ablations.main(asked)
    hanging, stereo = (load_segments(out / "seed_0" / f"{name}.npz") for name in ("hanging", "segments"))
    for folder, segments in (("no_LMVS", hanging), ("no_UNet", stereo)):
        torch.testing.assert_close(load_segments(out / "seed_0" / folder / "segments.npz").points, segments.points)
    # A second seed, as if it had been run before: its figures are read, and nothing runs again.
    shutil.copytree(out / "seed_0", out / "seed_1")
    for path in (out / "seed_1").rglob("figures.json"):
        figures = json.loads(path.read_text())
        figures["held_out_views"]["psnr"] += 2.0
        figures["described"]["seed"] = 1
        path.write_text(json.dumps(figures))
    monkeypatch.setattr(ablations, "run_fit", None)
    capsys.readouterr()
    ablations.main(replace(asked, seeds=2))
    printed = capsys.readouterr().out.splitlines()
    found = json.loads((out / "table.json").read_text())
    for name in ("no LMVS", "no UNet"):
        first, second = found[name]
        assert first["steps"] == second["steps"] == 4
        psnr = first["held_out_views"]["psnr"]
        assert second["held_out_views"]["psnr"] == pytest.approx(psnr + 2)
        assert any(line.startswith(f"| {name} | 200 |") and f"| {psnr + 1:.2f} ± 1.00 |" in line for line in printed)
    assert (out / "ablations.png").is_file()
