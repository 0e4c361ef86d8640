"""Curls: found in the photographs, by comparing their texture with that of drawn hair."""
