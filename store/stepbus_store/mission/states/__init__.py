"""The states of a sale: what each one does, the goal it sends, when it ends."""
