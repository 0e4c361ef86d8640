"""Differentiable image operators: lines, triangles, splat, texture, resample."""
