"""A UR5 whose motions are sampled, and what its tests ask of it."""

import numpy as np
import pytest
from support.services.manipulator import HOME, JOINTS, pose_goal

from stepbus_schemas import Goal
from stepbus_schemas.messages import Spiral
from stepbus_store.motion.outcome import Refused

TIP = "tool0"
AROUND = Spiral(centre=(0.45, 0.0, 0.3), radius=(0.3, 0.1), turns=2.0, rise=0.2)
SPIRAL = pose_goal("spiral", [0.45, 0.0, 0.6], spiral=AROUND)
ASIDE = HOME + np.array([0.8, 0.2, -0.3, 0.2, 0.1, -1.0])


def joints_goal(q=ASIDE, **fields):
    values = [float(x) for x in q]
    return Goal(id=0, type="move_joints", joints=list(JOINTS), values=values, **fields)


def tips(robot, rows):
    return np.array([robot.frame_pose(q, TIP).translation for q in rows])


def refusal(stage, goal, **begin):
    with pytest.raises(Refused) as refused:
        stage.start(goal, **begin)
    return refused.value
