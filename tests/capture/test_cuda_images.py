"""Stored samples on another device are the CPU's numbers."""

import numpy as np
import pytest
import torch
from emulated_device import on_device

from neural_strands.capture.images import to_unit, unit_tensor


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_samples_are_the_same_on_both_devices(kind: type, emulated: torch.device):
    stored = np.arange(np.iinfo(kind).max + 1).astype(kind).reshape(-1, 16)
    stored.flags.writeable = False
    there = unit_tensor(stored, emulated)
    assert on_device(there)
    assert torch.equal(there.cpu(), torch.from_numpy(to_unit(stored)))
    assert torch.equal(unit_tensor(stored, "cpu"), there.cpu())
