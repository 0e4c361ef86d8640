"""The head mesh, its scalp chart, and the roots of the strands with their frames."""
