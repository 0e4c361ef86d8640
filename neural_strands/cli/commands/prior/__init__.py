"""Commands of the strand prior."""
