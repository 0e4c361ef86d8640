"""The command for GPU machines: its parts exist and take their options; what is stopped goes on; its tables."""

import argparse
import dataclasses
import importlib.util
import json
import sys
from pathlib import Path

import pytest
import torch

from neural_strands.cli.main import _parse

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def gpu():
    """The module `benchmarks/gpu.py`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        yield importlib.import_module("gpu")


def options(out, **changes):
    plain = {"out": out, "capture": None, "device": "cpu", "quick": False, "gsplat": None, "opensplat": None}
    return argparse.Namespace(**{**plain, **changes})


def fields(script, monkeypatch):
    """Options of a program in `benchmarks/speed` or `benchmarks/rivals`."""
    monkeypatch.syspath_prepend(str(script.parent))
    spec = importlib.util.spec_from_file_location(f"speed_{script.stem}", script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
        flags = ("--", "--no-")
        names = (field.name.replace("_", "-") for field in dataclasses.fields(module.Arguments))
        return {f"{flag}{name}" for name in names for flag in flags}
    finally:
        del sys.modules[spec.name]


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("capture", [None, Path("capture")])
def test_every_part_exists_and_takes_its_options(gpu, tmp_path, monkeypatch, quick, capture):
    programs = {"gsplat": Path("simple_trainer.py"), "opensplat": Path("opensplat")} if quick else {}
    found = gpu.parts(options(tmp_path, quick=quick, capture=capture, **programs))
    assert len({part.name for part in found}) == len(found) >= 8
    for part in found:
        first, *words = part.command
        if words[:1] == ["pytest"]:
            assert (ROOT / words[4]).exists()
        elif words[:1] == ["neural_strands"]:
            assert _parse(words[1], words[2:]) is not None
        elif first != "-c":
            assert {word for word in words if word.startswith("--")} <= fields(ROOT / first, monkeypatch)


def test_a_stopped_part_goes_on_and_a_done_one_is_left_alone(gpu, tmp_path):
    program = """
import json, sys, time
from pathlib import Path
state = Path(sys.argv[1])
state.write_text(state.read_text() + "x" if state.exists() else "x")
if len(state.read_text()) < 2:
    time.sleep(60)
print(json.dumps({"runs": len(state.read_text())}))
"""
    part = gpu.Part("fit", ["-c", program, str(tmp_path / "state")], goes_on=True)
    assert not gpu.run(part, tmp_path, 4.0, whole=True)
    assert gpu.run(part, tmp_path, 60.0, whole=True)
    assert gpu.run(part, tmp_path, 60.0, whole=True)
    record = json.loads((tmp_path / "fit.json").read_text())
    assert record["runs"] == 2
    assert record["seconds"] >= 4


def test_a_part_that_cannot_end_in_a_call_fails_only_if_it_had_the_whole_call(gpu, tmp_path):
    part = gpu.Part("parity", ["-c", "import time; time.sleep(60)"])
    assert not gpu.run(part, tmp_path, 0.5, whole=False)
    assert not list(tmp_path.glob("*.json"))
    assert gpu.run(part, tmp_path, 0.5, whole=True)
    assert (tmp_path / "parity.failed.json").is_file()


def test_a_machine_that_lacks_something_is_told_before_any_part(gpu, tmp_path, monkeypatch, capsys):
    assert gpu.unready(options(tmp_path)) is None
    words = ["gpu.py", str(tmp_path / "out")]
    if not torch.cuda.is_available():
        monkeypatch.setattr(sys, "argv", words)
        assert gpu.main() == 2
        assert "expected a GPU that torch" in capsys.readouterr().err
    found = importlib.util.find_spec
    monkeypatch.setattr(gpu.importlib.util, "find_spec", lambda name: None if name in ("warp", "pxr") else found(name))
    monkeypatch.setattr(sys, "argv", [*words, "--device", "cpu"])
    assert gpu.main() == 2
    assert "found none of warp, pxr; run `pip install" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_tables_are_those_of_the_results(gpu, tmp_path):
    level = {"precision": 50.04, "recall": 40, "f_score": 44.5}
    records = {
        "parity_raster": {"summary": "9 passed"},
        "frame_1024": {
            "strands": 30000,
            "size": 1024,
            "milliseconds": {"decode": 3.5, "static_frame": 4.5, "dynamic_frame": 8},
            "peak_gigabytes": 2.5,
        },
        "step": {"output": "decode all      median     12.5 ms, least     11.0 ms\n"},
        "paper_fit": {"seconds": 660.0},
        "paper_scores": {
            "strands": {"1mm/10deg": level, "2mm/20deg": level, "3mm/30deg": level, "4mm/40deg": level},
            "held_out_views": {"count": 12, "psnr": 27.123, "ssim": 0.5, "lpips": None},
        },
        "rival_gsplat": {"skipped": "gsplat: there is no GPU"},
        "rival_opensplat": {
            "iterations": 7000,
            "minutes": 3.21,
            "scores": {"mean": {"hair": {"psnr": 25.5, "ssim": 0.625, "lpips": None}}},
        },
    }
    for name, record in records.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(record))
    (tmp_path / "prior.failed.json").write_text("{}")
    told = gpu.results(tmp_path, {"device": "H200"})
    assert told.startswith("## On a GPU\n\ndevice H200\n\nFailed, see the logs: prior.\n")
    for line in (
        "| `paper` preset, minutes | 10 | 11 |",
        "| static frame, 1024 x 1024, ms | 5 | 4.5 |",
        "| raster | 9 passed |",
        "| 30,000 | 1024 x 1024 | 3.5 | 4.5 | 8 | 2.5 |",
        "| decode all | 12.5 |",
        "| strands | 50.0 40.0 44.5 | 50.0 40.0 44.5 | 50.0 40.0 44.5 |",
        "| 12 | 27.12 | 0.5 | - |",
        "| gsplat | - | - | - | - | - | skipped: gsplat: there is no GPU |",
        "| opensplat | 7,000 | 3.2 | 25.5 | 0.625 | - |  |",
    ):
        assert line in told.splitlines()
    tiny = gpu.results(tmp_path, {"device": "H200"}, quick=True)
    assert "none of these figures counts" in tiny
    assert "Goals" not in tiny
