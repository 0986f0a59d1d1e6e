"""The process of a participant, or its thread in a run in one process."""
