"""Turns photographs of a person into a capture: cameras, landmarks, frame and scale, head and masks."""
