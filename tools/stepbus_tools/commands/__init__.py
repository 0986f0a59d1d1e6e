"""The commands of the tools; `stepbus` finds them by entry points."""
