"""Scenarios that ship with stepbus-store."""
