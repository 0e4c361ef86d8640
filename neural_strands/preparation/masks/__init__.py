"""Masks of the person and of the hair."""
