"""Photographs made ready: upright, in sRGB, of a sensible size, whatever they came as."""
