"""The files that a scenario names, and those that these name in turn."""
