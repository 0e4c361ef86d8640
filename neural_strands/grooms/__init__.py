"""Readers and writers of hair files."""
