"""Errors of the plant during a run; mistakes found before it starts are WiringErrors.

RunError
├─ InvalidInput
│  └─ CommandError (ValueError)    an invalid command; its sender is to blame
└─ PhysicsError (ArithmeticError)  the physics engine failed, or its state is not finite
"""

from stepbus_participant import InvalidInput
from stepbus_schemas import RunError


class CommandError(InvalidInput, ValueError):
    """An invalid joint command."""


class PhysicsError(RunError, ArithmeticError):
    """The physics engine failed, or its state is not finite."""
