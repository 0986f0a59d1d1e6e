"""Errors of the plant during a run; mistakes found before it starts are WiringErrors.

RunError
├─ CommandError (ValueError)       an invalid joint command
└─ PhysicsError (ArithmeticError)  the physics engine failed, or its state is not finite
"""

from stepbus_schemas import RunError


class CommandError(RunError, ValueError):
    """An invalid joint command."""


class PhysicsError(RunError, ArithmeticError):
    """The physics engine failed, or its state is not finite."""
