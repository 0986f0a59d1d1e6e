"""`python -m stepbus_motion.mobile`: goals of an arm on a mobile base with a gripper."""
