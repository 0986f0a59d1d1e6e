"""A scenario file as frozen types: its place, `extends`, `--set`, and every key."""
