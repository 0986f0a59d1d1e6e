"""Why a goal, a plan or an attempt failed, in one word for programs: one list for all services."""

from enum import StrEnum


class Cause(StrEnum):
    """A cause, as it stands in `GoalStatus.cause`, in `Plan.cause` and in the mission's report."""

    # Of a goal, from motion.
    ARM_JAMMED = "arm_jammed"
    BAD_PLAN = "bad_plan"
    BLOCKED = "blocked"
    COLLISION = "collision"
    EMERGENCY_STOP = "emergency_stop"
    IN_COLLISION = "in_collision"
    INVALID = "invalid"
    JAMMED = "jammed"
    LIMITS = "limits"
    NO_PATH = "no_path"
    NO_PLAN = "no_plan"
    NOT_HOLDABLE = "not_holdable"
    NOT_SETTLED = "not_settled"
    SINGULAR = "singular"
    SLOWER = "slower"
    STUCK = "stuck"
    TOO_FAR = "too_far"
    TOO_HIGH = "too_high"
    UNREACHABLE = "unreachable"

    # Of a plan, from the planner; stepbus itself sends `planner_failed` (`on_fault: hold`).
    BAD_REQUEST = "bad_request"
    GOAL_COLLIDES = "goal_collides"
    GOAL_IN_COLLISION = "goal_in_collision"
    OCCUPIED = "occupied"
    PATH_COLLIDES = "path_collides"
    PLANNER_FAILED = "planner_failed"
    START_COLLIDES = "start_collides"
    START_IN_COLLISION = "start_in_collision"

    # Of an attempt, from the mission.
    BLIND = "blind"
    DROPPED = "dropped"
    HIDDEN = "hidden"
    LYING = "lying"
    MISPLACED = "misplaced"
    MISSING = "missing"
    NO_ANSWER = "no_answer"
    NO_PERCEPTION = "no_perception"
    NO_POSE = "no_pose"
    NOT_DONE = "not_done"
    NOT_HELD = "not_held"
    SHELF_EMPTY = "shelf_empty"
    SLIPPED = "slipped"
    TILTED = "tilted"
    TOO_WIDE = "too_wide"
