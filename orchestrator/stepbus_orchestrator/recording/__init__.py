"""Writes and reads the recording of a run."""
