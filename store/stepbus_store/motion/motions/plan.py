"""From a planner's answer to a motion."""

import math

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Plan
from stepbus_store.motion.goals.outcome import Refused
from stepbus_store.motion.paths.joint_path import JointPath

from .trajectory import Timed


def planned(
    plan: Plan, start: Vector, goal: Vector, robot: RobotModel, *, tolerance: float = 1e-3
) -> Timed:
    """Return the motion of a plan, cubic between its samples.

    start, goal: where it must start and end, shape (n,) [rad], within `tolerance` [rad].
    Raises Refused with cause bad_plan for a plan that does not fit.
    """
    if (problem := _shape_problem(plan, len(robot.joints))) is not None:
        raise Refused("bad_plan", f"plan {plan.id} {problem}")
    u, q, slope = (
        np.array(row, dtype=np.float64) for row in (plan.times, plan.position, plan.velocity)
    )
    for name, wanted, got in (("start", start, q[0]), ("end", goal, q[-1])):
        worst = int(np.argmax(np.abs(got - wanted)))
        if abs(got[worst] - wanted[worst]) > tolerance:
            joint, unit = robot.joints[worst], robot.unit(robot.joints[worst])
            raise Refused(
                "bad_plan",
                f"plan {plan.id} has its {name} at {got[worst]:.4f} {unit} for {joint}, "
                f"not at {wanted[worst]:.4f} {unit}",
            )
    beyond = np.maximum(robot.lower - q, q - robot.upper).max(axis=0)
    if beyond.max() > tolerance:
        worst = int(np.argmax(beyond))
        joint = robot.joints[worst]
        text = f"{joint} {beyond[worst]:.4f} {robot.unit(joint)} beyond its limits"
        raise Refused("bad_plan", f"plan {plan.id} takes {text}")
    # From exactly where the arm is: the error of rounding fades on the path.
    share = (u / u[-1])[:, np.newaxis]
    q += (1.0 - share) * (start - q[0]) + share * (goal - q[-1])
    return Timed(JointPath(u=u, q=np.clip(q, robot.lower, robot.upper), slope=slope))


def _shape_problem(plan: Plan, joints: int) -> str | None:
    counts = {len(plan.times), len(plan.position), len(plan.velocity)}
    if len(counts) != 1 or len(plan.times) < 2:
        rows = f"{len(plan.times)} times, {len(plan.position)} positions"
        return f"has {rows} and {len(plan.velocity)} velocities; it needs at least 2 of each"
    if any(len(row) != joints for row in (*plan.position, *plan.velocity)):
        return f"has a row that is not of {joints} joints"
    numbers = [*plan.times, *(x for row in (*plan.position, *plan.velocity) for x in row)]
    if not all(map(math.isfinite, numbers)):
        return "has numbers that are not finite"
    gaps = [b - a for a, b in zip(plan.times, plan.times[1:], strict=False)]
    if plan.times[0] != 0 or min(gaps) <= 0:
        return "has times that do not increase from 0"
    if max(abs(x) for row in (plan.velocity[0], plan.velocity[-1]) for x in row) > 1e-3:
        return "does not start and end at rest"
    return None
