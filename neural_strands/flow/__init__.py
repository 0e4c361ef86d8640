"""The flow of the hair: a volume of growth directions, and first strands traced through it from the scalp."""
