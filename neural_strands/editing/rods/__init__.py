"""Strands simulated as rods: their shape at rest, steps of time, and strands that follow guides."""
