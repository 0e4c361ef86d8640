"""Warp kernels of `neural_strands.raster`."""
