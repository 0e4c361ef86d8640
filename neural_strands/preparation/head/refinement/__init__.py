"""Refines a placed head: skull, outline and shoulders as photographs with masks show them."""
