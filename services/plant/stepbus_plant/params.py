"""The plant's parameters in a scenario, with the script of a run."""

from collections.abc import Iterator
from functools import partial
from typing import Any, Literal

from stepbus_models import read_robot
from stepbus_participant import (
    Duration,
    File,
    Names,
    NonNegative,
    Positive,
    Settings,
    Share,
    Text,
    Vector3,
)
from stepbus_participant.parameters import Keys, Pause
from stepbus_plant.models import refuse_missing_meshes
from stepbus_plant.world import Actuation, EngineName, read_world
from stepbus_schemas import WiringError

Quantity = Literal["position", "velocity", "effort"]


class Noise(Settings):
    """Standard deviation of the Gaussian noise on each sensed quantity."""

    position: NonNegative = 0.0
    """[rad]"""
    velocity: NonNegative = 0.0
    """[rad/s]"""
    effort: NonNegative = 0.0
    """[N·m]"""


class Resolution(Settings):
    """Resolution of a sensor; absent: exact."""

    position: Positive | None = None
    """[rad]"""
    velocity: Positive | None = None
    """[rad/s]"""
    effort: Positive | None = None
    """[N·m]"""


class OdometryErrors(Settings):
    """Errors of the odometry of every base."""

    wheel: NonNegative = 0.0
    """Standard deviation of the radius of each wheel, relative to the nominal radius [-]."""
    slip: NonNegative = 0.0
    """Standard deviation of the slip of each wheel after 1 m; it grows with the square root of
    the distance [m]."""


class ProximityErrors(Settings):
    """Errors of the distances from contact sensors."""

    gain: Share = 0.0
    """Standard deviation of the gain error of each link's skin, drawn once per run [-]."""
    noise: Share = 0.0
    """Standard deviation of each measured distance, relative to the distance [-]."""


class FixedPoint(Settings):
    """A named point on a link, such as the tip of a tool."""

    link: Text
    """Link that the point is fixed to."""
    position: Vector3
    """Position in the frame of the link [m]; the orientation is the link's."""


class CameraErrors(Settings):
    """Errors of the images of all cameras."""

    depth: NonNegative = 0.0
    """Standard deviation of depth at 1 m; it grows with the square of the distance [m]."""
    depth_floor: NonNegative = 0.0
    """Additional standard deviation, independent of distance [m]."""
    depth_bias: NonNegative = 0.0
    """Standard deviation of a camera's constant depth offset, drawn once per run [m]."""
    color: NonNegative = 0.0
    """Standard deviation of each colour channel of a pixel, on a scale of 0 to 255 [-]."""
    blur: NonNegative = 0.0
    """Standard deviation of the blur of colours [pixel]."""
    light: Literal["even", "lamp"] = "even"
    """`even`: light from above, without shadows. `lamp`: a lamp at one side, drawn from the
    seed, with shadows and highlights; rendering then takes twice as long."""


class PushPort(Settings):
    """Where the messages of an input of type `Wrench/1` push."""

    link: Text
    """Link, or a body: its root link."""
    frame: Literal["world", "link"] = "world"
    """Frame of force and torque: `world`, or `link`, with which they turn."""
    point: Vector3 | None = None
    """Point where the force acts, and that the torque is about, in the frame of the link [m].
    Default: the centre of mass."""


_SUBJECTS = ("body", "push", "jam", "camera", "emergency_stop")
_OF_PUSH = ("force", "torque", "frame", "point")


class Action(Settings):
    """One action: a body moves or is pushed, a joint jams, a camera fails, or all brake."""

    at_ns: Pause
    """Simulation time, e.g. `6s`; executed at the first step at or after it."""
    body: str | None = None
    """Body that jumps to `position`, at rest, or moves to `to`."""
    position: Vector3 | None = None
    """New position of the body's frame in the world frame [m]."""
    to: Vector3 | None = None
    """Position that the body moves to in a straight line, ignoring obstacles [m]; needs `over`."""
    over_ns: Duration | None = None
    """Duration of that motion, at constant velocity, or of a push."""
    orientation_rpy: Vector3 | None = None
    """Roll, pitch, yaw of the body about fixed axes [rad]. Default: unchanged."""
    push: str | None = None
    """Link, or body, that is pushed with `force` and `torque`; needs `over`."""
    force: Vector3 | None = None
    """Force of a push [N]. Default: none."""
    torque: Vector3 | None = None
    """Torque of a push [N·m]. Default: none."""
    frame: Literal["world", "link"] | None = None
    """Frame of both: `world`, or `link`, with which they turn. Default: world."""
    point: Vector3 | None = None
    """Point where the force acts, and that the torque is about, in the frame of the link [m].
    Default: its centre of mass."""
    jam: str | None = None
    """Joint that jams: it holds its position from then on and ignores commands."""
    camera: str | None = None
    """Camera to switch off."""
    off: bool | None = None
    """Whether the camera is off; false: it resumes. Default: true."""
    emergency_stop: bool | None = None
    """True: start the emergency stop; false: release it."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions among the keys."""
        subjects = [key for key in _SUBJECTS if getattr(self, key) is not None]
        if len(subjects) != 1:
            given = " and ".join(subjects) or "none"
            yield (), f"needs exactly one of {', '.join(_SUBJECTS)}; it has {given}"
        elif self.body is not None and (self.position is None) == (self.to is None):
            yield (), "needs either 'position' or 'to'"
        elif self.push is not None and (self.over_ns is None or not (self.force or self.torque)):
            yield (), "a push needs 'over', and 'force' or 'torque'"
        if self.push is None:
            for key in (key for key in _OF_PUSH if getattr(self, key) is not None):
                yield (key,), "belongs to 'push'"
        if (self.to is None) != (self.over_ns is None) and self.push is None:
            yield (), "'to' and 'over' must be given together"


class Params(Settings):
    """Parameters of `stepbus_plant`."""

    world: File
    """World file: absolute, relative to the scenario, or `package://<package>/<path>`."""
    engine: EngineName | None = None
    """Physics engine, see [Engines](../guide/running/engines.md); overrides the world file.
    Default: the world's."""
    joints: Names | None = None
    """Joints to sense, in this order. The others can still be commanded. Default: all movable
    joints, in the order of the bodies and their models."""
    sense: tuple[Quantity, ...] = ("position", "velocity", "effort")
    """Quantities to sense. The others are absent from the `JointState`."""
    noise: Noise = Noise()
    """Standard deviation of Gaussian noise [rad, rad/s, N·m]."""
    resolution: Resolution = Resolution()
    """Resolution of the sensor [rad, rad/s, N·m]; readings are rounded to multiples of it,
    after adding noise. Default: exact."""
    odometry: OdometryErrors = OdometryErrors()
    """Errors of the odometry. Default: none."""
    camera: CameraErrors = CameraErrors()
    """Errors of camera images. Default: none."""
    proximity: ProximityErrors = ProximityErrors()
    """Errors of the distances from contact sensors. Default: none."""
    actuation: Actuation = "direct"
    """How to apply torques, unless the world file sets it for a joint."""
    effort: dict[str, NonNegative] = {}
    """Torque limit of a motor [N·m]; overrides the world file and the URDF."""
    poses: Names | None = None
    """Links and `points` of a `Poses/1`, in this order. Use the link name in the URDF, or
    `body/link` if bodies share it. Default: all."""
    points: dict[str, FixedPoint] = {}
    """Named points that are fixed to links."""
    pushes: dict[str, PushPort] = {}
    """Input of type `Wrench/1` → what it [pushes](../guide/running/push.md). Default: the link or
    body that has its name."""
    watchdog_ns: Duration | None = None
    """Time after the last command on an input until the plant brakes what the input drives, as
    in an emergency stop; the next command ends that. Default: a command holds until the next
    one."""
    poses_period_ns: Duration | None = None
    """Period of `Poses/1`, a multiple of the plant's step; measuring 54 links takes 0.25 ms.
    Default: each step."""
    physics_step_ns: Duration | None = None
    """Length of a physics substep; overrides the world file. Longer substeps are faster and
    less accurate. Default: the world's."""
    dynamics: Literal["on", "off"] = "on"
    """`off`: joints and bases follow their commands instantly, nothing falls, slips or pushes,
    and a gripper holds what it closes on. For fast debugging of missions; reports point it
    out."""
    cameras: bool = True
    """Whether cameras render images. A run without images is much faster."""
    stock: dict[str, Any] | None = None
    """Parameters of the class of the world's `stock`, see [Stock](world.md#stock). Default: its
    defaults."""
    script: tuple[Action, ...] = ()
    """Scripted changes of the world, see [Script](world.md#script)."""

    def file_problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the world file."""
        try:
            _, world, problems = read_world(self.world)
            problems.refuse()
            for name, body in world.bodies.items():
                robot = read_robot(body.urdf)
                problems.attempt(("bodies", name, "urdf"), partial(refuse_missing_meshes, robot))
            problems.refuse()
        except WiringError as exc:
            for line in str(exc).splitlines():
                yield ("world",), line
