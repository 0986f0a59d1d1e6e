"""Commands that test a participant."""
