"""Routes of a base on the floor."""
