"""What every layer leans on: errors for users, safe files, progress, kernel launches."""
