"""What flights are worth: accuracy, coverage, smoothness, wear."""
