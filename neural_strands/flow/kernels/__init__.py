"""Warp kernels over the voxels of a domain."""
