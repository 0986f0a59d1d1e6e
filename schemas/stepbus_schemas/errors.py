"""The root of every error stepbus raises.

StepbusError
├─ MessageError (ValueError)       a message, or its bytes, that is not what it should be
├─ WiringError (ValueError)        a scenario, port or type that cannot work; known before the run
└─ RunError (RuntimeError)         something that went wrong during a run
"""


class StepbusError(Exception):
    """Root of all errors raised by stepbus."""


class MessageError(StepbusError, ValueError):
    """A message, or its bytes on the wire, is not of its type."""


class WiringError(StepbusError, ValueError):
    """A scenario, a port or a message type cannot work as it is written."""


class RunError(StepbusError, RuntimeError):
    """A run, or a participant in it, failed."""
