"""Moves a gripper."""
