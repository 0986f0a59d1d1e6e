"""What a world file may say, as frozen types, and how it is read.

Relative file names are relative to the world file. Lengths [m], angles [rad], torques [N·m]; for
prismatic joints read [m] and [N] where an angle and a torque are named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from stepbus_participant.config import package_path
from stepbus_participant.durations import format_duration, parse_duration
from stepbus_plant.checked import (
    Finite,
    NonNegative,
    Positive,
    Problem,
    Source,
    Vector3,
    find_problems,
)
from stepbus_schemas import WiringError

from .stock import Item, StockParams, StockRow, draw_items, params_problems, stock_problems

Actuation = Literal["direct", "velocity_force"]
OwnMode = Literal["torque", "velocity", "position", "teleport"]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=4096)]


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mapping of the world file."""


class JointSettings(_Row, frozen=True):
    """What the world says about a joint, over what its URDF says; absent: the URDF holds."""

    mode: OwnMode | None = None
    """What commands mean to it: the only mode it takes. Default: torque."""
    motor: bool | None = None
    """Whether it has a motor; a joint without one swings freely. Default: true."""
    actuation: Actuation | None = None
    """How mode torque is carried out. Default: the plant's `actuation`, or direct."""
    position: Finite | None = None
    """At the start [rad]. Default: the place nearest to 0 within the limits."""
    velocity: Finite | None = None
    """At the start [rad/s]. Default: 0."""
    lower: Finite | None = None
    """Stop of the joint [rad]."""
    upper: Finite | None = None
    """Stop of the joint [rad]."""
    effort: NonNegative | None = None
    """Largest torque of its motor [N·m]; commands saturate at it."""
    max_velocity: NonNegative | None = None
    """Largest velocity of modes velocity and position [rad/s]; commands saturate at it."""
    damping: NonNegative | None = None
    """Viscous friction [N·m·s/rad]. Default: 0, whatever the URDF says."""
    friction: NonNegative | None = None
    """Coulomb friction [N·m], of mode torque with direct actuation. Default: 0, likewise."""

    def over(self, defaults: JointSettings) -> JointSettings:
        """Return these settings, with those of `defaults` where they are absent."""
        said = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not None}
        return msgspec.structs.replace(defaults, **said)


class Friction(_Row, frozen=True):
    """Contact friction of all links of a body [-]; absent: PyBullet's or the URDF's."""

    lateral: NonNegative | None = None
    rolling: NonNegative | None = None
    spinning: NonNegative | None = None


class Body(_Row, frozen=True):
    """A body, read from a URDF."""

    urdf: str
    """Beside the world file, absolute, or `package://<package>/<path>`."""
    srdf: str | None = None
    """File that names the pairs of links that never collide; the other pairs then do. It is found
    like `urdf`. Absent: the links of this body pass through one another."""
    visuals: bool = True
    """Whether to load the shapes that only cameras see."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position of the base in the world [m]."""
    orientation_rpy: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of the base in the world: roll, pitch, yaw about fixed axes [rad]."""
    fixed_base: bool = False
    friction: Friction = Friction()
    joint_defaults: JointSettings = JointSettings()
    """Holds for every joint of the body."""
    joints: dict[str, JointSettings] = {}
    """Joint of the URDF → settings over `joint_defaults`."""


class BaseRow(_Row, frozen=True):
    """A mobile base with two driven wheels on one axle."""

    left: str
    """Joint of the left wheel; it has mode velocity, and turns forward by positive angles."""
    right: str
    """Joint of the right wheel, likewise."""
    wheel_radius: Positive
    """[m]"""
    track: Positive
    """Distance between the wheels [m]."""


class GripperRow(_Row, frozen=True):
    """A gripper with two prismatic fingers, which are coupled."""

    left: str
    """Joint of one finger; it has mode velocity, and opens by positive positions."""
    right: str
    """Joint of the other finger, likewise."""
    speed: Positive = 0.1
    """Largest velocity of each finger [m/s]."""


class ContactsRow(_Row, frozen=True):
    """A sensor of contacts."""

    links: list[str] | None = None
    """Links whose contacts it shows; `<body>/*`: all links of a body. Default: all."""
    within: NonNegative = 0.0
    """It also shows what is this near to `links` and does not touch them, with force 0 [m]."""


class CameraRow(_Row, frozen=True):
    """A camera that shows colours and depth."""

    link: str
    """Its optical frame: z is the direction of view, x is right, y is down."""
    period: str
    """From one image to the next, e.g. `400ms`; a multiple of the plant's step."""
    width: Pixels = 320
    """[pixel]"""
    height: Pixels = 240
    """[pixel]"""
    fov: Positive = 1.0
    """Angle of view from the top to the bottom of the image [rad]."""
    near: Positive = 0.05
    """What is nearer than this is not seen [m]."""
    far: Positive = 3.0
    """What is farther than this is not seen [m]."""


class WorldFile(_Row, frozen=True):
    """What a world file says."""

    bodies: dict[str, Body]
    bases: dict[str, BaseRow] = {}
    grippers: dict[str, GripperRow] = {}
    contacts: dict[str, ContactsRow] = {}
    cameras: dict[str, CameraRow] = {}
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """[m/s²]"""
    physics_step: str | None = None
    """Length of a physics substep, e.g. `1ms`; has to divide the communication step exactly."""
    substeps: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """Physics substeps per communication step, instead of `physics_step`. Default: 1."""
    solver_iterations: Annotated[int, msgspec.Meta(ge=1)] = 50
    sleeping: bool = False
    """Whether bodies that have come to rest are left out until something moves them: faster."""
    stock: StockRow | None = None
    """Goods on shelves; each becomes a body."""


class World(WorldFile, frozen=True, kw_only=True):
    """Everything that is simulated; `urdf` and `srdf` of each body are absolute paths.

    source: the file it was read from, which knows the line of each mistake. items: body of the
    stock → what makes it different from its URDF. kinds: body of the stock → what it is.
    """

    source: Source
    items: dict[str, Item] = {}
    kinds: dict[str, str] = {}

    def physics_ns(self, period_ns: int, instead: str | None = None) -> int:
        """Return the length of a physics substep [ns].

        period_ns: length of a communication step [ns]. instead: the params' `physics_step`, which
        goes over that of the file. Raises WiringError when the substep does not divide the step
        exactly.
        """
        if instead is not None:
            step_ns = parse_duration(instead)
            if period_ns % step_ns:
                step = format_duration(period_ns)
                text = f"{instead} does not divide the plant's step of {step}"
                raise WiringError(f"params.physics_step: {text}")
            return step_ns
        if self.physics_step is not None:
            step_ns = parse_duration(self.physics_step)
            key, rest = "physics_step", period_ns % step_ns
            text = f"{self.physics_step} does not divide"
        else:
            step_ns, rest = divmod(period_ns, self.substeps or 1)
            key, text = "substeps", f"{self.substeps} substeps do not divide"
        if rest or not step_ns:
            tail = f"the plant's step of {period_ns} ns into whole nanoseconds"
            self.source.refuse([((key,), f"{text} {tail}")])
        return step_ns


def load_world(path: Path, stock: StockParams | None = None) -> World:
    """Read a world file.

    stock: what the plant's params say about the stock; None: nothing.
    Raises WiringError that lists all mistakes, each with file and line; those that only the URDFs
    can show come when the world is simulated.
    """
    source = Source(path)
    problems = [*find_problems(source.data, WorldFile), *_step_problems(source.data)]
    found: dict[str, dict[str, str]] = {}
    missing: set[str] = set()
    for name, key, file in _models(source.data):
        if name in missing:
            # Both files are of one package; that it is not installed is said once.
            continue
        try:
            found.setdefault(name, {})[key] = str(_find(file, path.parent))
        except WiringError as exc:
            problems.append((("bodies", name, key), str(exc)))
            missing.add(name)
    problems += _stock_files(source.data, path.parent)
    source.refuse(problems)
    content = msgspec.convert(source.data, WorldFile)
    fields = {key: getattr(content, key) for key in content.__struct_fields__}
    fields["bodies"] = {
        name: msgspec.structs.replace(body, **found[name]) for name, body in content.bodies.items()
    }
    items = _items(content, source, stock)
    fields["bodies"] |= {item.name: _body_of(item, path.parent) for item in items}
    kinds = {item.name: item.kind for item in items}
    return World(**fields, source=source, items={item.name: item for item in items}, kinds=kinds)


def _stock_files(data: Mapping[str, object], folder: Path) -> Iterator[Problem]:
    """Return which models of the stock's kinds there are not."""
    stock = data.get("stock")
    kinds = stock.get("kinds") if isinstance(stock, Mapping) else None
    for name, kind in kinds.items() if isinstance(kinds, Mapping) else ():
        file = kind.get("urdf") if isinstance(kind, Mapping) else None
        if isinstance(file, str):
            try:
                _find(file, folder)
            except WiringError as exc:
                yield ("stock", "kinds", str(name), "urdf"), str(exc)


def _items(content: WorldFile, source: Source, params: StockParams | None) -> list[Item]:
    """Return what is on the shelves.

    Raises WiringError for what the stock, or what the params say about it, gets wrong.
    """
    stock, given = content.stock, params or StockParams()
    if stock is not None:
        source.refuse(stock_problems(stock, given, list(content.bodies)))
    if params is not None and (problems := params_problems(stock, params)):
        raise WiringError("\n".join(problems))
    return [] if stock is None else draw_items(stock, given)


def _body_of(item: Item, folder: Path) -> Body:
    return Body(
        urdf=str(_find(item.urdf, folder)),
        position=item.position,
        orientation_rpy=(0.0, 0.0, item.yaw),
        friction=Friction(lateral=item.friction, spinning=item.spinning_friction),
    )


def _step_problems(data: Mapping[str, object]) -> Iterator[Problem]:
    if data.get("bodies") == {}:
        yield ("bodies",), "is empty; a world needs at least one body"
    text = data.get("physics_step")
    if isinstance(text, str):
        if "substeps" in data:
            yield ("substeps",), "choose one of 'physics_step' and 'substeps'"
        try:
            parse_duration(text)
        except WiringError as exc:
            yield ("physics_step",), str(exc)


def _models(data: Mapping[str, object]) -> Iterator[tuple[str, str, str]]:
    """Return body, key and the file it names, for as much of a world file as makes sense."""
    bodies = data.get("bodies")
    for name, body in bodies.items() if isinstance(bodies, Mapping) else ():
        for key in ("urdf", "srdf"):
            file = body.get(key) if isinstance(body, Mapping) else None
            if isinstance(file, str):
                yield str(name), key, file


def _find(name: str, folder: Path) -> Path:
    path = package_path(name) if name.startswith("package://") else folder / name
    if not path.is_file():
        raise WiringError(f"no file {name!r} ({path})")
    return path.resolve()
