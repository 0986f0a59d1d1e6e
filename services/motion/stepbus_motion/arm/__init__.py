"""`python -m stepbus_motion.arm`: goals of an arm."""
