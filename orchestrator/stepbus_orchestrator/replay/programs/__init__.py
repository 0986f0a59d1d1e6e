"""Whose programs a replay starts: those of the recording, or of the work tree."""
