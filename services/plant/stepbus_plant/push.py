"""Pushes: external forces and torques on links, for a time or until the next message of a port."""

import math
from typing import Any, ClassVar

import msgspec

from stepbus_participant import format_duration, suggest
from stepbus_plant.commander import Commander, CommandError
from stepbus_plant.drives import Motors
from stepbus_plant.engine import BASE, REST, Link
from stepbus_plant.geometry import Geometry
from stepbus_plant.memory import Remembers
from stepbus_plant.params import Action, PushPort
from stepbus_plant.physics import Physics
from stepbus_schemas import Point, WiringError

PUSH = "Wrench/1"
_EXACT = Geometry()
"""PyBullet's own is in single precision."""


class Push(msgspec.Struct):
    """A push that acts.

    force: at a point of a link [N]. torque: about that point [N·m]. point: in the frame of the link
    [m]; None: its centre of mass. turns: whether both turn with the link; otherwise they are along
    the axes of the world. left_ns: how long it still acts [ns]; None: for ever.
    """

    link: Link
    force: Point
    torque: Point
    point: Point | None
    turns: bool
    left_ns: int | None = None


def find_link(physics: Physics, name: object) -> Link:
    """Return a link by its name, or the root link of a body of that name.

    Raises WiringError for what is unknown, or cannot be pushed.
    """
    bodies = {body: (number, BASE) for number, body in enumerate(physics.bodies)}
    known: dict[str, Link] = {**bodies, **physics.links}
    # As in a view, which knows the names of bodies and models only.
    body, _, own = str(name).partition("/")
    more = physics.engine.links(bodies[body][0]) if body in bodies else {}
    link = known.get(str(name), more.get(own))
    if link is None:
        raise WiringError(f"link {name!r} is unknown{suggest(name, known)}")
    if physics.is_kinematic:
        raise WiringError("nothing can be pushed with `dynamics: off`")
    if link[1] == BASE and physics.world.bodies[physics.bodies[link[0]]].fixed_base:
        raise WiringError(f"{name!r} is fixed to the world (`fixed_base`): a push does not move it")
    return link


class Pushes(Remembers):
    """The pushes that act now; those on one link add up.

    timed: those of the script and of calls. held: port → its newest one. step_ns: length of a
    physics substep [ns].
    """

    remembers = ("timed", "held")
    timed: list[Push]
    held: dict[str, Push]

    def __init__(self, physics: Physics, step_ns: int) -> None:
        self._physics, self._engine, self._step_ns = physics, physics.engine, step_ns
        self.timed = []
        self.held = {}

    def __bool__(self) -> bool:
        """Return whether something is pushed."""
        return bool(self.timed or self.held)

    def begin(self, action: Action) -> str:
        """Begin a push; return what has happened, as a sentence.

        Raises WiringError as `find_link`.
        """
        link, over_ns = find_link(self._physics, action.push), action.over_ns or 0
        force, torque = action.force or REST, action.torque or REST
        turns = action.frame == "link"
        self.timed.append(Push(link, force, torque, action.point, turns, over_ns))
        given = ((action.force, "N"), (action.torque, "N·m"))
        text = " and ".join(f"{_listed(row)} {unit}" for row, unit in given if row is not None)
        text += " in its frame" if turns else ""
        text += "" if action.point is None else f" at its point {_listed(action.point)} m"
        return f"{action.push} is pushed with {text} for {format_duration(over_ns)}"

    def before_substep(self) -> None:
        """Apply what acts; the engine forgets it after every substep."""
        for push in self.held.values():
            self._apply(push, 1.0)
        for push in self.timed:
            left_ns = push.left_ns or 0
            # The rest of a substep is a part of the force: its impulse is force times time.
            self._apply(push, min(left_ns / self._step_ns, 1.0))
            push.left_ns = left_ns - self._step_ns
        if self.timed:
            self.timed = [push for push in self.timed if (push.left_ns or 0) > 0]

    def _apply(self, push: Push, share: float) -> None:
        (fx, fy, fz), (tx, ty, tz) = push.force, push.torque
        force, torque = (fx * share, fy * share, fz * share), (tx * share, ty * share, tz * share)
        if push.turns or push.point is not None:
            turn = self._engine.frame(push.link)[1]
            if push.turns:
                force, torque = _EXACT.turned(turn, force), _EXACT.turned(turn, torque)
            if push.point is not None:
                (x, y, z), (cx, cy, cz) = push.point, self._engine.inertial(push.link)[0]
                x, y, z = _EXACT.turned(turn, (x - cx, y - cy, z - cz))
                (fx, fy, fz), (tx, ty, tz) = force, torque
                torque = tx + y * fz - z * fy, ty + z * fx - x * fz, tz + x * fy - y * fx
        self._engine.shove(push.link, force, torque)


class PushDriver(Commander):
    """Pushes a link as the messages of one input say; each holds until the next one.

    row: of the params; None: the port has the name of the link.
    """

    obeys_stop: ClassVar[bool] = False

    def __init__(self, port: str, row: PushPort | None, pushes: Pushes, motors: Motors) -> None:
        super().__init__(port, [], motors)
        row = row or PushPort(link=port)
        self._pushes, self._row = pushes, row
        self._link = find_link(motors.physics, row.link)

    def apply(self, command: Any) -> None:
        """Push by a Wrench from now on; raises CommandError for what is not finite."""
        for key, values in (("force", command.force), ("torque", command.torque)):
            if not all(map(math.isfinite, values)):
                text = f"{key} on {self._row.link} is {_listed(values)}, not three finite numbers"
                raise CommandError(self._port, text)
        self._pushes.held.pop(self._port, None)
        if any((*command.force, *command.torque)):
            row = self._row
            push = Push(self._link, command.force, command.torque, row.point, row.frame == "link")
            self._pushes.held[self._port] = push


def _listed(values: Point) -> str:
    return ", ".join(f"{value:g}" for value in values)
