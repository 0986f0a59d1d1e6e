"""What a policy sees and does."""

from typing import Literal

import msgspec

from stepbus_participant import Settings


class Params(Settings):
    """Parameters of a policy; `StepbusEnv` writes them."""

    policy: str = ""
    """The function of an observation that returns an action, `module:function`; a class is made
    once. Empty: the command line names it."""
    observe: tuple[str, ...] = ()
    """What it sees, `port` or `port.field`, in this order. Empty: all numbers of all inputs."""
    act: tuple[str, ...] = ()
    """What it does, `port` or `port.field`."""
    joints: tuple[str, ...] = ()
    """Which joints it commands. Empty: those of its first input of joint states."""
    mode: Literal["torque", "velocity", "position"] = "torque"
    """How it commands joints."""
    limits: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)
    """`port.field` → lowest and highest value, where nothing describes them."""
