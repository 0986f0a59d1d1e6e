"""A policy as a participant of its own: `python -m stepbus_gym.policy module:function`."""
