"""A template head fitted to a person."""
