"""`python -m stepbus_store.motion.arm`: goals of an arm."""
