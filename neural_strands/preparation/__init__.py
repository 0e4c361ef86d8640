"""From a person's photographs to a capture: cameras, landmarks, frame and scale, head and masks."""
