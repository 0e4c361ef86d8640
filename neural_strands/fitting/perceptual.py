"""The perceptual distance that a fit trains with."""

from collections.abc import Callable

import torch

from neural_strands.evaluation.lpips import TRAINING_NETWORK, find_lpips
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.fitting.losses import Perceptual


def perceptual_loss(device: torch.device, say: Callable[[str], None]) -> Perceptual:
    """LPIPS if its weights are available; otherwise the structural loss, which is announced through `say`."""
    metric, reason = find_lpips(TRAINING_NETWORK, device)
    if metric is not None:
        return metric
    say(f"{reason}; training uses the structural loss instead")
    return structural_loss
