"""What an error sentence suggests: the nearest name, the extra to install."""
