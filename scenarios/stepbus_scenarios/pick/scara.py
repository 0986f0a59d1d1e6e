"""The kinematics of a SCARA arm, in closed form."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_models import Joint, RobotDescription, read_robot
from stepbus_participant import suggest
from stepbus_schemas import WiringError

_TURNS = ("revolute", "continuous")
_TYPES = (_TURNS, _TURNS, ("prismatic",), _TURNS)
_NAMES = ("shoulder", "elbow", "lift", "wrist")
_EPS = 1e-9

_Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Tool:
    """Where the tip of an arm is, in the frame of its base: x, y, z [m] and yaw [rad]."""

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True, kw_only=True)
class Scara:
    """An arm of two links in a horizontal plane, with a vertical axis and a wrist at their end.

    Joints in this order: shoulder, elbow, lift, wrist. near, far: lengths of the links [m].
    height: of the tip above the base, with the lift at 0 [m]. lower, upper: limits of the joints
    [rad, rad, m, rad]. velocity: the same [rad/s, rad/s, m/s, rad/s].
    """

    joints: tuple[str, ...]
    near: float
    far: float
    height: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]

    @classmethod
    def read(cls, path: Path, joints: Sequence[str], base: str, tip: str) -> "Scara":
        """Return the arm of a URDF.

        joints: shoulder, elbow, lift and wrist. base, tip: links. Raises WiringError for a model
        that is no such arm.
        """
        chain = _chain(read_robot(path), base, tip)
        moving = [joint for joint in chain if joint.type != "fixed"]
        names = tuple(joint.name for joint in moving)
        if names != tuple(joints):
            text = f"the joints from {base} to {tip} are {', '.join(names) or 'none'}"
            raise WiringError(f"{path.name}: {text}, not {', '.join(joints)}")
        for joint, types, role in zip(moving, _TYPES, _NAMES, strict=True):
            _check(joint, types, role, path)
        ends = [chain.index(joint) for joint in moving]
        at = [
            _sum(chain[i + 1 : j + 1])
            for i, j in zip([-1, *ends], [*ends, len(chain)], strict=True)
        ]
        far = tuple(a + b for a, b in zip(at[2], at[3], strict=True))
        aside = (at[0][0], at[0][1], at[1][1], far[1], at[4][0], at[4][1])
        if max(map(abs, aside)) > _EPS or min(at[1][0], far[0]) <= 0:
            raise WiringError(
                f"{path.name}: the origins of {', '.join(names)} and {tip} are not aligned along x"
            )
        limits = [_limits(joint) for joint in moving]
        lower, upper, velocity = zip(*limits, strict=True)
        return cls(
            joints=names,
            near=at[1][0],
            far=far[0],
            height=sum(row[2] for row in at),
            lower=lower,
            upper=upper,
            velocity=velocity,
        )

    @property
    def lowest(self) -> float:
        """Return the smallest height of the tip above the base [m]."""
        return round(self.height + self.lower[2], 9) + 0.0

    def forward(self, q: Sequence[float]) -> Tool:
        """Return where the tip is; q: joint positions, shape (4,) [rad, rad, m, rad]."""
        shoulder, elbow, lift, wrist = q
        return Tool(
            x=self.near * math.cos(shoulder) + self.far * math.cos(shoulder + elbow),
            y=self.near * math.sin(shoulder) + self.far * math.sin(shoulder + elbow),
            z=self.height + lift,
            yaw=shoulder + elbow + wrist,
        )

    def inverse(self, tool: Tool, *, near: float = 0.0) -> list[float] | None:
        """Return joint positions at which the tip is somewhere; None: it is out of reach.

        near: position of the wrist [rad]; the yaw that is reached is any number of quarters of a
        turn from that of the tool, with the wrist within a quarter around this. The elbow is
        positive unless only its other side is within the limits.
        From the law of cosines; Siciliano et al., Robotics, 2009, section 2.12.1.
        """
        reach = tool.x * tool.x + tool.y * tool.y
        cosine = (reach - self.near**2 - self.far**2) / (2 * self.near * self.far)
        if abs(cosine) > 1.0:
            return None
        for elbow in (math.acos(cosine), -math.acos(cosine)):
            along = self.near + self.far * math.cos(elbow)
            shoulder = math.atan2(tool.y, tool.x) - math.atan2(self.far * math.sin(elbow), along)
            shoulder = math.remainder(shoulder, math.tau)
            wrist = near + math.remainder(tool.yaw - shoulder - elbow - near, math.pi / 2)
            q = [shoulder, elbow, tool.z - self.height, wrist]
            if all(a <= b <= c for a, b, c in zip(self.lower, q, self.upper, strict=True)):
                return q
        return None


def _chain(robot: RobotDescription, base: str, tip: str) -> list[Joint]:
    """Return the joints from one link to another; raises WiringError where there are none."""
    name = robot.path.name
    for link in (base, tip):
        if link not in robot.links:
            raise WiringError(f"{name}: link {link!r} is unknown{suggest(link, robot.links)}")
    chain: list[Joint] = []
    link = tip
    while link != base:
        joint = robot.joint_above.get(link)
        if joint is None:
            raise WiringError(f"{name}: no chain of joints connects link {base!r} to {tip!r}")
        chain.insert(0, joint)
        link = joint.parent
    return chain


def _check(joint: Joint, types: Sequence[str], role: str, path: Path) -> None:
    """Raise WiringError for a joint that is none of a SCARA arm."""
    if joint.type not in types:
        text = f"is {joint.type}; the {role} of a SCARA arm must be {' or '.join(types)}"
        raise WiringError(f"{path.name}: joint {joint.name!r} {text}")
    if joint.axis != (0.0, 0.0, 1.0):
        raise WiringError(f"{path.name}: the axis of joint {joint.name!r} must be 0 0 1")


def _sum(joints: Sequence[Joint]) -> _Vector:
    """Return the sum of the origins of joints [m]; raises WiringError for one that is turned."""
    x = y = z = 0.0
    for joint in joints:
        if any(joint.pose.rpy):
            raise WiringError(f"the origin of joint {joint.name!r} is rotated; remove its rpy")
        dx, dy, dz = joint.pose.xyz
        x, y, z = x + dx, y + dy, z + dz
    return (x, y, z)


def _limits(joint: Joint) -> tuple[float, float, float]:
    """Return lower and upper limit and velocity [rad, rad/s]; infinite: none."""
    lower = -math.inf if joint.lower is None else joint.lower
    upper = math.inf if joint.upper is None else joint.upper
    return lower, upper, joint.velocity or math.inf
