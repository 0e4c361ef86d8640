"""Foundations of all layers: errors for users, safe files, progress, kernel launches."""
