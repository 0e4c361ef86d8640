"""The flow of the hair: a volume of growth directions, and initial strands traced through it from the scalp."""
