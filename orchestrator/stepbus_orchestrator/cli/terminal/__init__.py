"""The terminal: what a command prints and where, its progress, the keys that control a run."""
