"""What the replayed participant publishes, beside what it published in the recording."""
