"""A planar arm on a chassis among boxes, and a planner for it without a bus."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from support.services.control import Stand, make_config

from stepbus_participant import Config
from stepbus_schemas import Description, Plan, PlanRequest, Poses
from stepbus_store.planner.planner import Planner
from stepbus_store.planner.scene import Margins, Scene, Surroundings

MS = 1_000_000
JOINTS = ["one", "two", "three"]
START, GOAL = [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]
PILLAR = ("pillar", "box 0.1 0.1 1", (0.6, 0.0, 0.5))
WALL = ("wall", "box 0.9 0.05 1", (0.65, 0.0, 0.5))
NO_TURN = (0.0, 0.0, 0.0, 1.0)

_LINK = """
<link name="link_{n}"><inertial><origin xyz="{c} 0 0"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="{c} 0 0"/><geometry><box size="{size} 0.04 0.04"/></geometry></collision>
</link><joint name="{name}" type="revolute"><parent link="{parent}"/><child link="link_{n}"/>
<origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/>
<limit lower="-2.6" upper="2.6" effort="{effort}" velocity="2"/></joint>"""


def write_arm(folder: Path, effort: float = 100.0, axis: str = "0 0 1") -> Path:
    """Write arm.urdf: links of 0.4, 0.3 and 0.2 m at a height of 0.5 m, and a tip at their end."""
    parents, lengths = ["chassis", "link_0", "link_1"], [0.4, 0.3, 0.2]
    rows = [
        _LINK.format(
            n=n, c=length / 2, size=length - 0.06, name=JOINTS[n], parent=parents[n],
            x=[0.0, *lengths][n], z=0.5 if n == 0 else 0, effort=effort, axis=axis,
        )
        for n, length in enumerate(lengths)
    ]  # fmt: skip
    hand = (
        '<link name="tip"/><joint name="hand" type="fixed"><parent link="link_2"/>'
        '<child link="tip"/><origin xyz="0.2 0 0"/></joint>'
        '<link name="wheel"><collision><geometry><sphere radius="0.1"/></geometry></collision>'
        '</link><joint name="wheel_joint" type="continuous"><parent link="chassis"/>'
        '<child link="wheel"/><axis xyz="0 1 0"/></joint>'
    )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="chassis"/>{"".join(rows)}{hand}</robot>')
    return path


def config(folder: Path, *, every: int = 1, event: bool = True, **params: Any) -> Config:
    """Return the configuration of a planner for the arm in arm.urdf, in steps of 8 ms."""
    inputs = {"request": "PlanRequest/1", "poses": "Poses/1"}
    outputs = {"plan": "Plan/1", **({"event": "Event/1"} if event else {})}
    params = {"model": "arm.urdf", "joints": JOINTS, "tip": "tip", **params}
    return make_config(
        "planner", inputs, outputs, folder, params=params, step_ns=8 * MS, every=every, seed=3
    )


Thing = tuple[str, str, tuple[float, float, float]]


def scenery(*things: Thing, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """Return the description and the poses of a world; things: name, shape, position [m].

    shift: of everything, the robot too [m].
    """
    rows = [("chassis", "", (0.0, 0.0, 0.0)), *things]
    described = Description(
        names=[name for name, _, _ in rows],
        details={
            "shape": [f"{shape} @ 0 0 0 0 0 0 1" if shape else "" for _, shape, _ in rows],
            "body": ["robot", *(name for name, _, _ in things)],
        },
    )
    position = [tuple(a + b for a, b in zip(at, shift, strict=True)) for _, _, at in rows]
    return described, Poses(position=position, orientation=[NO_TURN] * len(rows))


def make_planner(folder: Path, described: Description, **params: Any) -> Planner:
    """Return a started planner."""
    if not (folder / "arm.urdf").exists():
        write_arm(folder)
    planner = Planner(config(folder, **params))
    planner.start({"request": Description(names=JOINTS), "poses": described})
    return planner


def answer(folder: Path, *things: Thing, request: dict[str, Any] | None = None, **params: Any):
    """Return the plan for a request from START to GOAL, and the planner that made it."""
    described, poses = scenery(*things)
    planner = make_planner(folder, described, **params)
    asked = PlanRequest(**{"id": 1, "start": START, "goal": GOAL, **(request or {})})
    try:
        stand = Stand(planner)
        messages = [stand.update(0, request=asked, poses=poses)]
        messages += [stand.update(k) for k in range(1, 27)]
        plans = [message["plan"] for message in messages if "plan" in message]
    finally:
        planner.close()
    (plan,) = plans
    return plan, planner


def every_ms(plan: Plan) -> np.ndarray:
    """Return the positions of a plan every ms, shape (k, n) [rad]."""
    spline = CubicHermiteSpline(plan.times, plan.position, plan.velocity)
    return spline(np.arange(0, plan.times[-1], 1e-3))


def scene_of(planner: Planner, start: list[float], *things: Thing, **around: Any) -> Scene:
    """Return a scene without margins."""
    obstacles = planner.planner.obstacles
    placements = obstacles.placements(scenery(*things)[1])
    surroundings = Surroundings(links=obstacles.links, placements=placements, tip="tip", **around)
    margins = Margins(robot=0, held=0, standing=0)
    return Scene(planner.planner.robot, surroundings, np.array(start), margins)


def touched(planner: Planner, plan: Plan, *things: Thing, **around: Any) -> list[str]:
    """Return what the robot touches anywhere on a plan, looked at every ms without margins."""
    scene = scene_of(planner, plan.position[0], *things, **around)
    touches = (scene.touch(q) for q in every_ms(plan))
    return list(dict.fromkeys(str(t) for t in itertools.islice(filter(None, touches), 5)))
