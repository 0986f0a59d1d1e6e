"""Carries out goals: of an arm, or of an arm on a mobile base with a gripper."""
