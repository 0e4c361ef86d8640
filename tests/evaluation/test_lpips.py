import hashlib
import pickle

import pytest
import torch

from neural_strands.capture.images import read_pixels, to_unit
from neural_strands.evaluation.lpips import Lpips, find_lpips
from neural_strands.evaluation.lpips_trunks import LAYOUTS, build_trunk
from neural_strands.evaluation.lpips_weights import HEADS, load_heads
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.published_files import FOLDER_VARIABLE


@pytest.fixture
def metric(shared_data, monkeypatch) -> Lpips:
    monkeypatch.setenv(FOLDER_VARIABLE, str(shared_data / "lpips_squeeze"))
    found, why = find_lpips("squeeze", fetch=False)
    assert found is not None, why
    return found


def example(folder, name: str) -> torch.Tensor:
    return torch.from_numpy(to_unit(read_pixels(folder / "lpips_squeeze" / f"ex_{name}.png")))


def test_reference_scores(metric, shared_data):
    reference = example(shared_data, "ref")
    assert metric(example(shared_data, "p0"), reference).item() == pytest.approx(0.71105, abs=1e-5)
    assert metric(example(shared_data, "p1"), reference).item() == pytest.approx(0.14790, abs=1e-5)
    assert metric(reference, reference).item() == 0


@pytest.mark.parametrize(("seed", "expected"), [(42, 0.10049), (123, 0.10080)])
def test_scores_of_noise_that_torchmetrics_publishes(metric, seed, expected):
    random = torch.Generator().manual_seed(seed)
    a, b = (torch.rand(10, 3, 100, 100, generator=random).movedim(1, -1) for _ in range(2))
    assert metric(a, b).mean().item() == pytest.approx(expected, abs=1e-5)


def test_a_full_mask_is_no_mask_and_a_part_sees_its_part(metric, shared_data):
    image, reference = example(shared_data, "p0"), example(shared_data, "ref")
    torch.testing.assert_close(metric(image, reference, torch.ones(64, 64)), metric(image, reference))
    patched = reference.clone()
    patched[:, 40:] = image[:, 40:]
    left = torch.zeros(64, 64)
    left[:, :16] = 1.0
    right = torch.zeros(64, 64)
    right[:, 48:] = 1.0
    assert metric(patched, reference, left) < 0.1 * metric(patched, reference, right)
    assert metric(patched, reference, torch.zeros(64, 64)).isnan()


def test_gradient_reaches_the_image_only_and_agrees_with_a_step(metric, shared_data):
    metric.train()
    assert not metric.training
    assert not any(parameter.requires_grad for parameter in metric.parameters())
    exact = metric.double()
    reference = example(shared_data, "ref").double()
    image = example(shared_data, "p1").double().requires_grad_()
    exact(image, reference).backward()
    step = 1e-6 * torch.randn(64, 64, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    with torch.no_grad():
        change = exact(image + step, reference) - exact(image - step, reference)
    assert change.item() == pytest.approx(2 * (image.grad * step).sum().item(), rel=1e-4)
    equal = reference.clone().requires_grad_()
    exact(equal, reference).backward()
    assert equal.grad is not None
    assert torch.isfinite(equal.grad).all()


@pytest.mark.parametrize("network", ["squeeze", "alex", "vgg"])
def test_taps_have_the_channels_of_the_published_heads(network, shared_data):
    path = shared_data / "lpips_squeeze" / HEADS[network].names[0]
    assert hashlib.sha256(path.read_bytes()).hexdigest() == HEADS[network].sha256
    heads = load_heads(network, path)
    assert all((head >= 0).all() for head in heads)
    trunk = build_trunk(network).state_dict()
    random = Lpips(network, {name: torch.zeros_like(value) for name, value in trunk.items()}, heads)
    found = random.features(torch.zeros(1, 3, 64, 64))
    assert tuple(tap.shape[1] for tap in found) == LAYOUTS[network].channels == tuple(len(head) for head in heads)
    # Names and shapes that torchvision publishes for the deepest layer used.
    deepest = {"squeeze": ("12.expand3x3.weight", (256, 64, 3, 3)), "alex": ("10.weight", (256, 256, 3, 3))}
    name, shape = deepest.get(network, ("28.weight", (512, 512, 3, 3)))
    assert trunk[name].shape == shape


def test_absent_weights_are_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found, why = find_lpips("alex", fetch=False)
    assert found is None
    assert why.startswith("LPIPS (alex) is absent: ")
    assert FOLDER_VARIABLE in why
    assert "\n" not in why


def test_anything_but_tensors_is_refused(tmp_path):
    class Trap:
        def __reduce__(self):
            return (print, ("unpickled",))

    (tmp_path / "trap.pth").write_bytes(pickle.dumps(Trap(), protocol=2))
    (tmp_path / "noise.pth").write_bytes(b"\x00" * 100)
    torch.save([1, 2], tmp_path / "list.pth")
    torch.save({"lin0.model.1.weight": torch.zeros(3)}, tmp_path / "shape.pth")
    torch.save({"a": torch.zeros(300)}, tmp_path / "whole.pth")
    (tmp_path / "short.pth").write_bytes((tmp_path / "whole.pth").read_bytes()[:-400])
    (tmp_path / "empty.pth").write_bytes(b"")
    for name in ("trap", "noise", "list", "shape", "short", "empty", "absent"):
        with pytest.raises(InputError, match=f"{name}.pth: expected") as caught:
            load_heads("squeeze", tmp_path / f"{name}.pth")
        assert "\n" not in str(caught.value)


def test_images_must_not_be_tiny(metric):
    with pytest.raises(ValueError, match="32 pixels"):
        metric(torch.zeros(16, 40, 3), torch.zeros(16, 40, 3))
