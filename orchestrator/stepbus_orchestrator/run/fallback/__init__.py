"""What a run does without a participant that has failed: `on_fault: hold`."""
