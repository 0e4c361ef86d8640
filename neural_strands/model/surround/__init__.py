"""What lies behind the hair: the body, skin that the hair hides, and the background."""
