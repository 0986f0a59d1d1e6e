"""The planner: finds collision-free paths of a robot's joints, timed within its limits."""
