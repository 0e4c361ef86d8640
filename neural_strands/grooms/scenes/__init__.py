"""Files for other programs: grooms with guides and motion; formats that are written only."""
