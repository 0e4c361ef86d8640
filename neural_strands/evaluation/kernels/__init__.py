"""Warp kernels of `neural_strands.evaluation`."""
