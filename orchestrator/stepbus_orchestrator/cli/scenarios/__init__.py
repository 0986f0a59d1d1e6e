"""Commands that run or check a scenario."""
