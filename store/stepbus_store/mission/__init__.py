"""Sales in a store: a state machine that fetches items from shelves, one after the other."""
