"""Edits of fitted hair: pure functions of strands and scalp textures."""
