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
_EPS = 1e-9


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A place of a cube or of the arm's tip in the frame of its base: x, y, z [m], yaw [rad]."""

    x: float
    y: float
    z: float
    yaw: float

    def __str__(self) -> str:
        return f"{self.x:.3f}, {self.y:.3f} m, {math.degrees(self.yaw):.0f}°"


@dataclass(frozen=True, kw_only=True)
class Scara:
    """An arm of two links in a horizontal plane, with a vertical axis and a wrist at their end.

    Its joints are shoulder, elbow, lift and wrist, in this order. near, far: lengths of the links
    [m]. height: of the tip above the base, with the lift at 0 [m]. lower, upper: limits of the
    joints, shape (4,) [rad, rad, m, rad]. velocity: limits, shape (4,) [rad/s, rad/s, m/s, rad/s].
    """

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
        if names != tuple(joints) or len(names) != len(_TYPES):
            text = f"the joints from {base} to {tip} are {', '.join(names) or 'none'}"
            wanted = f"{', '.join(joints)}; give shoulder, elbow, lift and wrist"
            raise WiringError(f"{path.name}: {text}, not {wanted}")
        for joint, types in zip(moving, _TYPES, strict=True):
            if joint.type not in types or joint.axis != (0.0, 0.0, 1.0):
                wanted = f"must be {' or '.join(types)} with the axis 0 0 1"
                raise WiringError(f"{path.name}: joint {joint.name!r} {wanted}")
        for joint in chain:
            if any(joint.pose.rpy):
                raise WiringError(f"{path.name}: the origin of joint {joint.name!r} is rotated")
        ends = [chain.index(joint) for joint in moving]
        at = [
            [sum(joint.pose.xyz[axis] for joint in chain[i + 1 : j + 1]) for axis in range(3)]
            for i, j in zip([-1, *ends], [*ends, len(chain)], strict=True)
        ]
        far = [a + b for a, b in zip(at[2], at[3], strict=True)]
        aside = (at[0][0], at[0][1], at[1][1], far[1], at[4][0], at[4][1])
        if max(map(abs, aside)) > _EPS or min(at[1][0], far[0]) <= 0:
            raise WiringError(
                f"{path.name}: the origins of {', '.join(names)} and {tip} are not aligned along x"
            )
        return cls(
            near=at[1][0],
            far=far[0],
            height=sum(row[2] for row in at),
            lower=tuple(-math.inf if j.lower is None else j.lower for j in moving),
            upper=tuple(math.inf if j.upper is None else j.upper for j in moving),
            velocity=tuple(j.velocity or math.inf for j in moving),
        )

    @property
    def lowest(self) -> float:
        """Return the smallest height of the tip above the base [m]."""
        return round(self.height + self.lower[2], 9) + 0.0

    def inverse(self, tip: Spot, *, near: float = 0.0) -> list[float] | None:
        """Return joint positions with the tip at a spot, shape (4,); None: it is out of reach.

        near: position of the wrist [rad]; the yaw that is reached is any number of quarters of a
        turn from that of the spot, with the wrist within a quarter around this. The elbow is
        positive unless only its other side is within the limits.
        From the law of cosines; Siciliano et al., Robotics, 2009, section 2.12.1.
        """
        reach = tip.x * tip.x + tip.y * tip.y
        cosine = (reach - self.near**2 - self.far**2) / (2 * self.near * self.far)
        if abs(cosine) > 1.0:
            return None
        for elbow in (math.acos(cosine), -math.acos(cosine)):
            along = self.near + self.far * math.cos(elbow)
            shoulder = math.atan2(tip.y, tip.x) - math.atan2(self.far * math.sin(elbow), along)
            shoulder = math.remainder(shoulder, math.tau)
            wrist = near + math.remainder(tip.yaw - shoulder - elbow - near, math.pi / 2)
            q = [shoulder, elbow, tip.z - self.height, wrist]
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
