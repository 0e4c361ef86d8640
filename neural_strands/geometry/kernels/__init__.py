"""Warp kernels of `neural_strands.geometry`."""
