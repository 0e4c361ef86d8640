"""Warp kernels of `neural_strands.lmvs`."""
