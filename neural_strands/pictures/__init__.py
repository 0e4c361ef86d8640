"""Pictures for reports: fields, lines in space and plots as images, and the encoding of images as files."""
