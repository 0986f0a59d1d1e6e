"""The orchestrator's end of the bus: all it publishes, and all it waits for."""
