"""What a law knows about the robot it controls."""

from dataclasses import dataclass

import numpy as np

from stepbus_controller import Params
from stepbus_kinematics import RobotModel, Vector
from stepbus_participant import Config
from stepbus_schemas import WiringError


@dataclass(frozen=True, kw_only=True)
class Robot:
    """The joints under control, in the order of every vector.

    effort_limit: largest torques, shape (n,) [N·m]. model: None where the scenario names no URDF.
    """

    joints: tuple[str, ...]
    effort_limit: Vector
    model: RobotModel | None = None

    def require_model(self) -> RobotModel:
        """Return the model; raises WiringError where the scenario names no URDF."""
        if self.model is None:
            raise WiringError("this law needs 'model', the robot's URDF")
        return self.model


def make_robot(config: Config, params: Params) -> Robot:
    """Return the robot that the parameters describe.

    Raises SettingsError with what is wrong with the URDF, the joints or the effort limits.
    """
    problems = config.problems().below(("params",))
    model, joints = None, params.joints
    if params.model is not None:
        path = params.model
        model = problems.attempt(
            ("model",), lambda: RobotModel(path, joints, gravity=params.gravity)
        )
        problems.refuse()
        joints = model.joints if model is not None else joints
    names = joints or ()
    if params.effort_limit is not None:
        limit = np.array(params.effort_limit.of(names))
    else:
        limit = model.effort_limit if model is not None else np.zeros(len(names))
        for name, value in zip(names, limit.tolist(), strict=True):
            if not 0 < value < np.inf:
                unit = "N·m" if model is None else model.effort_unit(name)
                text = f"is {value:g} {unit} for {name!r} in the model; set it here"
                problems.add(("effort_limit",), text)
    problems.refuse()
    return Robot(joints=names, effort_limit=limit, model=model)
