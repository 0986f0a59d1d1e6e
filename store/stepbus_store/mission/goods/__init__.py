"""What the store sells: the types, the items on the shelves, and who moved them."""
