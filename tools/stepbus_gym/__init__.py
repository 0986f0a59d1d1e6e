"""Scenarios as Gymnasium environments (docs/guide/running/gymnasium.md).

`import stepbus_gym` registers `stepbus/two_link-v0`.
"""

from stepbus_participant import need

try:
    from gymnasium.envs.registration import register, registry

    from .env import Moment, StepbusEnv
    from .fields import Field
    from .render import Camera
    from .vector import StepbusVectorEnv
except ModuleNotFoundError:
    # Where it is Gymnasium, this says how to install it.
    need("stepbus_gym", "gymnasium")
    raise

__all__ = ["Camera", "Field", "Moment", "StepbusEnv", "StepbusVectorEnv"]

TWO_LINK = "stepbus/two_link-v0"

if TWO_LINK not in registry:
    register(id=TWO_LINK, entry_point="stepbus_gym.two_link:make")
