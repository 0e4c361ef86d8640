"""Pictures for people: fields, lines in space and plots as images, and the encoding of images as files."""
