"""What the participants of a scenario say of themselves before any step."""
