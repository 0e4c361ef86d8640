"""Losses, schedules, and the loops that train the prior and fit a capture."""
