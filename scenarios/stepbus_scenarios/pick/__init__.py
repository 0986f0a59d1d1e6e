"""A SCARA arm that picks a cube: the scenario, and its mission."""
