"""What is drawn of a recording as curves, and said of it in lines."""
