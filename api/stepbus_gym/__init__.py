"""Scenarios as Gymnasium environments (docs/guide/running/gymnasium.md).

`import stepbus_gym` registers `stepbus/two_link-v0`.
"""

from stepbus_participant import need

need("stepbus_gym", "gymnasium")

from gymnasium.envs.registration import register, registry  # noqa: E402

from .env import Moment, StepbusEnv  # noqa: E402
from .fields import Field  # noqa: E402
from .render import Camera  # noqa: E402

__all__ = ["Camera", "Field", "Moment", "StepbusEnv"]

TWO_LINK = "stepbus/two_link-v0"

if TWO_LINK not in registry:
    register(id=TWO_LINK, entry_point="stepbus_gym.two_link:make")
