"""Scenarios that ship with stepbus."""
