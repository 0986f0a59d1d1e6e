"""A run that is going, while it is recorded: its page, and what a user can ask of it."""
