"""The checks, by the part of docs/protocol.md that they check."""
