"""A recording with joints, a base on a circle, a camera and events: what a page shows of it."""

import math

from support.messages.recordings import write

from stepbus_orchestrator.run.result import Result
from stepbus_schemas import BaseState, Description, Event, Image, JointState, Scalars

LIMITS = {"lower": [-1.0, -2.0], "upper": [1.0, 2.0], "velocity": [3.0, 3.0], "effort": [50.0, 9.0]}
STEPS = 400
RADIUS = 1.5


def state(step):
    t = step / 100
    return JointState(position=[math.sin(t), math.cos(t)], velocity=[math.cos(t), -math.sin(t)])


def base(step):
    """A base on a circle about the origin, [m]."""
    turn = 2 * math.pi * step / STEPS
    return BaseState(x=RADIUS * math.cos(turn), y=RADIUS * math.sin(turn), yaw=turn, vx=1.0, wz=0.0)


def image(step):
    data = bytes([step % 256]) * (4 * 3 * 3)
    return Image(width=4, height=3, encoding="rgb8", data=data, focal=(4.0, 4.0), centre=(2.0, 1.5))


def write_recording(path):
    """Write a recording of all that a page shows; return its path."""
    steps = range(STEPS)
    hostile = Event(level="warning", text="</script><script>alert(1)</script>")
    joints = Description(names=["hip", "knee"], limits=LIMITS)
    return write(
        path,
        joint_state=("JointState/1", joints, [state(step) for step in steps]),
        odometry=("BaseState/1", [], [base(step) for step in steps]),
        voltage=("Scalars/1", ["left", "right"], [Scalars(values=[12.0, 11.5])] * STEPS),
        camera=("Image/1", [], [image(step) for step in steps]),
        events=("Event/1", [], [None] * 100 + [hostile]),
    )


def save_result(folder, **fields):
    """Write the result of a run that the plant has failed at step 9, but for some fields."""
    result = {
        "scenario": "arm", "outcome": "failed", "exit_code": 4, "reason": "it raised",
        "participant": "plant", "at_step": 9, "steps": 9, "step_ns": 10_000_000, "seed": 0,
        "window": 8, "transport": "unix", "start_s": 0.1, "wall_s": 1.0, "real_time_factor": 1.2,
        "sha256": "", "folder": str(folder),
    }  # fmt: skip
    Result(**(result | fields)).save()
