"""Runs a scenario: start-up, stepping, closing, shutdown."""
