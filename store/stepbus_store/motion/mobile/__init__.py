"""`python -m stepbus_store.motion.mobile`: goals of an arm on a mobile base with a gripper."""
