"""A mission that sends goals one after the other."""
