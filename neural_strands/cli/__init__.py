"""The command line: one module per command; the only place that parses arguments, seeds and picks a device."""

from neural_strands.cli.main import main

__all__ = ["main"]
