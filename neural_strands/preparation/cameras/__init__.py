"""Cameras of photographs: found by structure from motion, or read from the files of other programs."""
