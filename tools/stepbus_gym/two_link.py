"""`stepbus/two_link-v0`: make the planar arm follow its reference."""

from typing import Any

import numpy as np

from .env import Moment, StepbusEnv

_EFFORT = 1e-4
_FAR = 2.0


def tracking(moment: Moment) -> float:
    """Return minus the squared tracking error [rad²], and a little for the torque's square."""
    error = _error(moment)
    return -float(error @ error) - _EFFORT * float(np.square(moment.action / 50.0).sum())


def lost(moment: Moment) -> bool:
    """Return whether a joint is over 2 rad off."""
    return bool(np.abs(_error(moment)).max() > _FAR)


def _error(moment: Moment) -> Any:
    measured, wanted = moment.inputs["joint_state"], moment.inputs["reference"]
    return np.subtract(wanted.position, measured.position)


def make(**options: Any) -> StepbusEnv:
    """Return the environment; options: those of `StepbusEnv`."""
    given = {"scenario": "two_link", "reward": tracking, "terminated": lost, **options}
    return StepbusEnv(**given)
