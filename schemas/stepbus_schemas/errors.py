"""The root of every error stepbus raises.

StepbusError
├─ MessageError (ValueError)       bytes that are not the message they should be
├─ WiringError (ValueError)        a scenario, port or type that cannot work; known before the run
└─ RunError (RuntimeError)         something that went wrong during a run
"""


class StepbusError(Exception):
    """Root of all errors raised by stepbus."""


class MessageError(StepbusError, ValueError):
    """Bytes on the wire are not the message their encoding names."""


class WiringError(StepbusError, ValueError):
    """A scenario, a port or a message type cannot work as it is written."""


class RunError(StepbusError, RuntimeError):
    """A run, or a participant in it, failed."""
