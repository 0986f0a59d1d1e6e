"""Runs and recordings for Foxglove and Lichtblick: foxglove.* messages, and who sends them."""
