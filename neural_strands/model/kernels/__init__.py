"""Warp kernels of `neural_strands.model`."""
