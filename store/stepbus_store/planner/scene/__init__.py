"""What a plan must not touch: the robot, the obstacles around it, and their pairs."""
