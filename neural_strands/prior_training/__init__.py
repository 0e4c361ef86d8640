"""Training of the strand prior: curves, losses, schedule."""
