"""What the terminal shows, and the keys it takes."""
