"""The planner: ways of the joints that touch nothing, timed within limits."""
