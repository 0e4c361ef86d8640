"""Procedural grooms, a dome of cameras and a path tracer: a capture with ground truth."""
