"""What a participant offers to be called between two steps."""
