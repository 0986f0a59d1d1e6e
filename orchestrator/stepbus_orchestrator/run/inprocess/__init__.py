"""A run in one process: participants take turns on one thread, over a bus in memory."""
