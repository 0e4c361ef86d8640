"""What photographs ask of the fit: regions to compare, trimaps, weights beside the hair, and streaks."""
