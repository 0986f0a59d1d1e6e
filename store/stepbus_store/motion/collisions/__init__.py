"""Watches the contacts of a robot."""
