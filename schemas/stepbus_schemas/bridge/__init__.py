"""What the bridge speaks to a program: text, lines, bytes."""
