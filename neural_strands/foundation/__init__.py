"""What every layer builds on: errors for users, safe files, progress, kernel launches."""
