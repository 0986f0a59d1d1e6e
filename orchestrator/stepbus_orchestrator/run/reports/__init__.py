"""What a run reports: events, progress, its result."""
