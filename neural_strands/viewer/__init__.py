"""A page in the browser that shows, edits and saves hair; no maths of its own."""
