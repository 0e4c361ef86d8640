"""Cameras of photographs: estimated by structure from motion, or read from the files of other programs."""
