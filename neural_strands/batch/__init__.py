"""Batches of many subjects on one or many machines: every stage of every subject is a task of a Ray cluster."""
