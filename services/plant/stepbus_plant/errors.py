"""What can go wrong in the plant during a run; what is wrong before it is a WiringError.

RunError
├─ CommandError (ValueError)       a joint command that cannot be carried out
└─ PhysicsError (ArithmeticError)  the physics engine failed, or its state left the finite numbers
"""

from __future__ import annotations

from stepbus_schemas import RunError


class CommandError(RunError, ValueError):
    """A joint command that cannot be carried out."""


class PhysicsError(RunError, ArithmeticError):
    """The physics engine failed, or its state left the finite numbers."""
