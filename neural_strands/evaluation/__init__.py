"""Geometry and image metrics, timing, and the report."""
