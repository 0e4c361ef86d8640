"""The panel of a page: controls to view, change and save what the page shows."""
