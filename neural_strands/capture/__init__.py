"""Captures on disk: images, masks and calibrated cameras, read lazily and checked."""
