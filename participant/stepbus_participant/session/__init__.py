"""One participant's part in a run: admission, handshakes, steps, and the end."""
