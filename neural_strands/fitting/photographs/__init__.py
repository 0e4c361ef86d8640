"""What photographs tell a fit: regions to compare, trimaps, streaks, and the background with its distances."""
