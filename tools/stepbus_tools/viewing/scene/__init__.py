"""What a recording shows: frames, what they look like, and where messages place them."""
