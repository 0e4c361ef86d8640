"""Settings of a fit from presets, files and single options."""

import json
import subprocess
import sys
import typing
from dataclasses import asdict, is_dataclass, replace

import pytest

from neural_strands.cli.commands.fit import Fit
from neural_strands.cli.main import main
from neural_strands.fitting.config import FitConfig, FitWeights, preset
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError


def settings(*words: str) -> FitConfig | None:
    command = Fit.parse("neural-strands fit", ["capture", "run", *words])
    assert command is not None
    return command.settings


def test_a_single_setting_changes_the_preset_and_nothing_else():
    found = settings("--preset", "demo", "--config.weights.alpha", "0.3", "--config.model.unet.widths", "8", "16")
    demo = preset("demo")
    model = replace(demo.model, unet=replace(demo.model.unet, widths=(8, 16)))
    assert found == replace(demo, weights=FitWeights(alpha=0.3), model=model)


def test_without_settings_none_are_loaded():
    assert settings("--preset", "demo", "--steps", "3") is None


def test_a_run_and_a_part_of_it_are_accepted_as_files(tmp_path):
    stored = replace(preset("paper"), steps=77, weights=FitWeights(head=2.0))
    run = {"format": 2, "version": "0", "capture": "a", "config": asdict(stored)}
    (tmp_path / "run.json").write_text(json.dumps(run))
    changed = settings("--config", str(tmp_path / "run.json"), "--config.steps", "5")
    assert changed == replace(stored, steps=5)
    (tmp_path / "part.toml").write_text("steps = 9\n[weights]\nalpha = 0.25\n")
    changed = settings(f"--config={tmp_path / 'part.toml'}", "--preset", "demo", "--config.crop", "64")
    assert changed == replace(preset("demo"), steps=9, crop=64, weights=FitWeights(alpha=0.25))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("--config.weights.alpah 1", "--config.weights.alpah: expected an option such as --config.weights.alpha"),
        ("--config.weights.alpha -1", "--config: weights.alpha: expected a finite number from 0.0"),
        ("--config.weights.alpha nan", "--config: weights.alpha: expected a finite number"),
        ("--config.steps 1.5", "--config.steps: expected a whole number, found '1.5'"),
        ("--config.model.textures.shape-size 8192", "--config: model.textures.shape_size: expected 268435456 numbers"),
        ("--config.stereo.confirming inf", "--config: stereo.confirming: expected a finite number"),
        ("--config none.json", "none.json: expected settings"),
        ("--preset slow", "--preset: expected one of"),
        ("--preset slow --config.steps 3", "preset: expected one of demo, fast, paper, found 'slow'"),
        ("--minutes inf", "--minutes: expected a finite number"),
        ("--minutes -1", "--minutes: expected a finite number from 0.01"),
        ("--steps 0", "--steps: expected a whole number from 1"),
        ("--seed -1", "--seed: expected a whole number from 0"),
    ],
)
def test_wrong_settings_are_one_sentence_before_anything_is_read(words, sentence, tmp_path, capsys):
    assert main(["fit", str(tmp_path / "none"), str(tmp_path / "run"), *words.split()]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"neural-strands: {sentence}"), told
    assert told.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_help_lists_every_setting_when_asked(capsys):
    assert main(["fit", "--help-config"]) == 0
    told = capsys.readouterr().out
    for name in ("steps", "weights.alpha", "stereo.confirming", "growth.gravity", "model.unet.widths"):
        assert f"--config.{name}" in told


def test_every_number_of_the_settings_has_bounds():
    def unbounded(config, place):
        for name, hint in typing.get_type_hints(config, include_extras=True).items():
            if is_dataclass(hint):
                yield from unbounded(hint, f"{place}{name}.")
            elif {"int", "float"} & set(repr(hint).replace("[", " ").replace("'", " ").replace(">", " ").split()):
                extras = [*typing.get_args(hint), *(e for each in typing.get_args(hint) for e in typing.get_args(each))]
                if not any(isinstance(extra, Between) for extra in extras):
                    yield f"{place}{name}"

    assert list(unbounded(FitConfig, "")) == []


def test_plain_help_does_not_load_torch():
    script = "import sys; from neural_strands.cli.main import main; main(['fit', '--help']);"
    script += "sys.exit('torch' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True)
    assert "--help-config" in shown.stdout


def test_presets_are_named():
    with pytest.raises(InputError, match="expected one of demo, fast, paper, found 'slow'"):
        preset("slow")
