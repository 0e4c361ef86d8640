"""Low-pass filters by the Kaiser window method, for resampling and for filtered activations.

Frequencies are in cycles per sample of the grid that the filter runs on, so 0.5 is that grid's Nyquist frequency.
Source: Kaiser 1974 by way of the StyleGAN3 paper (Karras et al. 2021), appendix C.1, equations for h_K, A and alpha.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.configs import Between


@dataclass(frozen=True)
class LowPass:
    """A symmetric low-pass filter that runs on a fine grid, `factor` times as dense as the coarse one."""

    taps: Annotated[int, Between(2, 256)] = 12
    """Number of coefficients; even, because the samples of the two grids are half a fine sample apart."""
    factor: Annotated[int, Between(1, 16)] = 2
    """Fine samples per coarse sample."""
    cutoff: Annotated[float, Between(1e-6, 64)] = 0.45
    """Frequency of half amplitude, cycles per coarse sample; 0.5 is the coarse grid's Nyquist frequency."""
    transition: Annotated[float, Between(1e-6, 64)] = 0.3
    """Full width of the transition band, cycles per coarse sample."""

    def __post_init__(self) -> None:
        if self.taps < 2 or self.taps % 2 or self.factor < 1 or self.cutoff <= 0 or self.transition <= 0:
            raise ValueError(f"a low-pass filter needs an even number of taps and positive frequencies, found {self}")

    def coefficients(self) -> Float[Tensor, " tap"]:
        """Coefficients that sum to one (float32)."""
        return kaiser_lowpass(self.taps, self.cutoff / self.factor, self.transition / self.factor)


def kaiser_lowpass(taps: int, cutoff: float, transition: float) -> Float[Tensor, " tap"]:
    """Windowed sinc 2 f_c sinc(2 f_c x) w_K(x), scaled to sum to one.

    Args:
        taps: number of coefficients.
        cutoff: frequency of half amplitude f_c, cycles per sample.
        transition: full width of the transition band, cycles per sample; determines the side lobes of the window.
    """
    position = np.arange(taps) - (taps - 1) / 2
    window = np.kaiser(taps, kaiser_shape(kaiser_attenuation(taps, transition)))
    response = np.sinc(2 * cutoff * position) * window
    return torch.from_numpy(response / response.sum()).float()


def kaiser_attenuation(taps: int, transition: float) -> float:
    """Stop-band attenuation in dB of a window of this length: A = 2.285 (n - 1) 2 pi df + 7.95."""
    return 2.285 * (taps - 1) * 2 * math.pi * transition + 7.95


def kaiser_shape(attenuation: float) -> float:
    """Kaiser's window parameter for a stop-band attenuation in dB."""
    if attenuation > 50:
        return 0.1102 * (attenuation - 8.7)
    if attenuation > 21:
        return 0.5842 * (attenuation - 21) ** 0.4 + 0.07886 * (attenuation - 21)
    return 0.0
