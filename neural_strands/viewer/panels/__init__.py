"""The panel of a page: controls that look at, change and save what the page shows."""
