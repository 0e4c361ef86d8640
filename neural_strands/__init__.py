"""Reconstruct explicit hair strands and a neural appearance from calibrated photographs of a head."""

__version__ = "0.1.0"
