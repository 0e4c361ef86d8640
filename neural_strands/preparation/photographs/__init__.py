"""Imports photographs from any format: upright, in sRGB, of a sensible size."""
