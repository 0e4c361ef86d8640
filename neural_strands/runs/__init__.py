"""A run's folder: start, resume, outputs, evaluation and report."""
