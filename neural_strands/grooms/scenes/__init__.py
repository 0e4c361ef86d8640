"""Export for other programs: grooms with guides and motion, and write-only formats."""
