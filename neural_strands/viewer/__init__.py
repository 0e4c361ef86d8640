"""A page in the browser that shows, edits and saves hair; it contains no maths."""
