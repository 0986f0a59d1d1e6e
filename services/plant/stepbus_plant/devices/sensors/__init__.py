"""Sensors that a world declares: inertial units, force-torque sensors, lidars, transforms."""
