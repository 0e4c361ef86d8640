"""Warp kernels of edits."""
