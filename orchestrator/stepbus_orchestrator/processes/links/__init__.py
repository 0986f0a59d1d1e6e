"""How the processes of a run find and authenticate each other."""
