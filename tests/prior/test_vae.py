"""The prior's file and its limits."""

import copy
import json
import struct
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch
from damage import merged
from safetensors.torch import save_file

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import lengths
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.vae import SHIPPED, StrandPrior, load_prior, save_prior


@pytest.fixture(scope="module")
def prior() -> StrandPrior:
    return load_prior()


@pytest.fixture(scope="module")
def curves() -> torch.Tensor:
    return synthetic_curves(50, torch.Generator().manual_seed(0))


def test_reading_what_was_written_is_the_identity(prior: StrandPrior, tmp_path: Path) -> None:
    save_prior(prior, tmp_path / "prior.safetensors", {"seed": "0"})
    again = load_prior(tmp_path / "prior.safetensors")
    assert again.generator.config == prior.generator.config
    assert again.encoder.config == prior.encoder.config
    for name, value in prior.state_dict().items():
        assert torch.equal(value, again.state_dict()[name])


def test_shipped_weights_are_small_frozen_and_load_quickly() -> None:
    assert SHIPPED.stat().st_size < 4_000_000
    seconds, parameters = [], []
    for _ in range(5):
        start = time.process_time()
        prior = load_prior()
        seconds.append(time.process_time() - start)
        parameters += prior.parameters()
    assert min(seconds) < 0.1
    assert not any(value.requires_grad for value in parameters)


def test_curves_survive_the_round_trip(prior: StrandPrior, curves: torch.Tensor) -> None:
    assert 1000 * (prior.decode(prior.encode(curves)) - curves).norm(dim=-1).mean() < 0.2


def test_strands_are_moved_to_the_root_and_resampled(prior: StrandPrior, curves: torch.Tensor) -> None:
    moved = curves + torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(prior.decode(prior.encode(moved)), prior.decode(prior.encode(curves)), atol=2e-3, rtol=0)
    coarse = prior.decode(prior.encode(curves[:, ::3]), 100)
    assert 1000 * (coarse - curves).norm(dim=-1).median() < 0.5


def test_without_modulator_the_strands_are_the_same(prior: StrandPrior, curves: torch.Tensor) -> None:
    bare = prior.without_modulator()
    torch.testing.assert_close(bare.decode(bare.encode(curves)), prior.decode(prior.encode(curves)), atol=1e-4, rtol=0)
    with pytest.raises(ValueError, match="only a coupling modulator"):
        StrandPrior(GeneratorConfig(modulator="mlp")).without_modulator()


def test_latents_of_curves_are_near_standard_normal(prior: StrandPrior) -> None:
    latent = prior.encode(synthetic_curves(1000, torch.Generator().manual_seed(7)))
    assert latent.mean(dim=0).abs().max() < 0.25
    assert latent.std(dim=0).min() > 0.7
    assert latent.std(dim=0).max() < 1.4


def test_samples_are_strands_of_plausible_length_without_spikes(prior: StrandPrior, generator: torch.Generator) -> None:
    strands = prior.decode(torch.randn(1000, 64, generator=generator))
    length = lengths(strands)
    assert torch.isfinite(strands).all()
    assert length.quantile(0.01) > 0.005
    assert length.quantile(0.99) < 0.8
    assert (length > 1.0).float().mean() < 0.004
    step = strands.diff(dim=1).norm(dim=-1) / (length[:, None] / 99)
    assert (step - 1).abs().median() < 0.16


def test_no_strand_has_no_latent(prior: StrandPrior) -> None:
    assert prior.encode(torch.zeros(0, 100, 3)).shape == (0, 64)


def test_strands_longer_than_in_training_are_encoded_at_their_scale(prior: StrandPrior) -> None:
    curves = synthetic_curves(20, torch.Generator().manual_seed(3))
    long = curves * (1.2 / lengths(curves))[:, None, None]
    error = (prior.decode(prior.encode(long)) - long).norm(dim=-1).mean()
    assert error < 0.005 * 1.2


@pytest.mark.parametrize(
    ("strands", "message"),
    [
        (torch.zeros(2, 1, 3), "expected at least two points each, found 1; drop them."),
        (
            torch.full((3, 100, 3), torch.nan),
            "3 of 3 hold NaN or infinite coordinates .the first is strand 0.; drop them.",
        ),
        (torch.zeros(4, 100, 3), "4 of 4 are shorter than 3 mm or longer than 2 m .strand 0 is 0 m.; check the unit"),
        (torch.linspace(0, 25, 300).reshape(1, 100, 3), "1 of 1 are shorter .* .strand 0 is 43.01 m.; check the unit"),
    ],
)
def test_strands_without_a_latent_are_refused_in_one_sentence(
    prior: StrandPrior, strands: torch.Tensor, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        prior.encode(strands)


def test_two_points_are_enough(prior: StrandPrior) -> None:
    strand = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.03, 0.04]]])
    decoded = prior.decode(prior.encode(strand))
    torch.testing.assert_close(decoded[0, -1], strand[0, -1], atol=2e-4, rtol=0)


def test_broken_weights_are_named_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "prior.safetensors"
    with pytest.raises(InputError, match="found no file"):
        load_prior(path)
    whole = SHIPPED.read_bytes()
    header = 8 + struct.unpack("<Q", whole[:8])[0]
    for size in (0, 5, header // 2, header, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="expected the complete weights of a strand prior") as caught:
            load_prior(path)
        assert "\n" not in str(caught.value)
    save_file({"a": torch.zeros(3)}, path)
    with pytest.raises(InputError, match="expected the complete weights"):
        load_prior(path)


def test_weights_of_another_shape_are_refused(prior: StrandPrior, tmp_path: Path) -> None:
    path = tmp_path / "prior.safetensors"
    save_prior(prior, path, {})
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    tensors = prior.state_dict()
    tensors["generator.linear.weight"] = tensors["generator.linear.weight"][:, :10].clone()
    save_file(tensors, path, metadata=metadata)
    with pytest.raises(InputError, match=r"expected the complete weights of a strand prior, found something else"):
        load_prior(path)


SIZES = {
    "layers": ({"generator": {"layers": 2**63}}, r"config: generator\.layers: expected a whole number from 0 to 64"),
    "warps": ({"generator": {"synthesiser": {"warps": 10**7}}}, r"generator\.synthesiser\.warps: expected a whole"),
    "text": ({"generator": {"latent": "64"}}, r"generator\.latent: expected a whole number from 1 to 512, found '64'"),
    "kind": ({"generator": {"modulator": "gru"}}, "modulator: expected one of coupling, mlp, found 'gru'"),
    "widths": ({"encoder": {"widths": [16] * 100}}, "widths: expected a list of 1 to 8 elements"),
    "unknown": ({"encoder": {"depth": 3}}, "encoder.depth: expected a setting that EncoderConfig has"),
    "odd": ({"generator": {"latent": 63}}, "coupling layers need an even latent"),
    "none": ({"generator": None}, "a value under 'generator'"),
}


@pytest.mark.parametrize("name", sorted(SIZES))
def test_sizes_beyond_reason_are_refused_before_anything_is_built(prior: StrandPrior, tmp_path: Path, name: str):
    changes, message = SIZES[name]
    path = tmp_path / "prior.safetensors"
    save_prior(prior, path, {})
    described: dict[str, Any] = {"generator": asdict(prior.generator.config), "encoder": asdict(prior.encoder.config)}
    for part, values in changes.items():
        described[part] = None if values is None else merged(described[part], values)
    save_file(prior.state_dict(), path, metadata={"config": json.dumps(described)})
    with pytest.raises(InputError, match=message) as caught:
        load_prior(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("config", ["[" * 100_000, "no", "[]", '{"generator": {}, "generator": {}}'])
def test_sizes_that_are_no_json(prior: StrandPrior, tmp_path: Path, config: str):
    save_file(prior.state_dict(), tmp_path / "prior.safetensors", metadata={"config": config})
    with pytest.raises(InputError, match=r"prior\.safetensors: config: expected"):
        load_prior(tmp_path / "prior.safetensors")


def test_weights_that_are_not_finite(prior: StrandPrior, tmp_path: Path):
    broken = copy.deepcopy(prior)
    with torch.no_grad():
        broken.generator.linear.weight[0, 0] = torch.nan
    save_prior(broken, tmp_path / "prior.safetensors", {})
    with pytest.raises(InputError, match=r"NaN or infinity in generator\.linear\.weight"):
        load_prior(tmp_path / "prior.safetensors")
