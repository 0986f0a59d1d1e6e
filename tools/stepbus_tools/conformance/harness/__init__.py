"""The run around the program under test: plays the orchestrator and all of its peers."""
