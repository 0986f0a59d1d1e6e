"""stepbus."""
