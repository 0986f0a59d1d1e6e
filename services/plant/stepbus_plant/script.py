"""What happens in a world, and when: by its script, or by a call."""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial

from stepbus_participant import Problems, format_duration, suggest
from stepbus_plant.camera import Camera
from stepbus_plant.commander import StopSwitch
from stepbus_plant.engine import BASE, Contact, Engine, Goal, Link
from stepbus_plant.geometry import Pose, quaternion
from stepbus_plant.memory import Remembers
from stepbus_plant.params import Action
from stepbus_plant.physics import Physics
from stepbus_plant.push import Pushes, find_link
from stepbus_schemas import Point

# More torque than any motor has, and the share of the error corrected per substep: a wheel at
# 5 rad/s under a base of 80 kg stops within 0.022 rad, and within 0.001 rad after 0.1 s.
_JAM_EFFORT = 1e6
_JAM_GAIN = 0.5

_OVERLAP = 2e-3
"""Deeper than that, a body has been put into another one [m]."""


class MovingBody:
    """Moves from where it is to a pose, at constant velocities.

    seconds: duration of the motion. blow: the first contact with another body, with the force of
    its first substep [N], once there was one; is_told: whether it has been reported.
    """

    def __init__(self, engine: Engine, body: int, goal: Pose, seconds: float) -> None:
        self._engine = engine
        self._body = body
        self._start, self._goal = engine.frame((body, BASE)), goal
        self._seconds = seconds
        self._elapsed = 0.0
        ends = zip(self._start[0], goal[0], strict=True)
        vx, vy, vz = ((b - a) / seconds for a, b in ends)
        self._velocity = (vx, vy, vz)
        self._spin = engine.geometry.spin_between(self._start[1], goal[1], seconds)
        self._touched = {contact.other for contact in engine.contacts(body)}
        self.blow: Contact | None = None
        self.is_told = False

    @property
    def is_there(self) -> bool:
        """Return whether it has arrived, and stands."""
        return self._elapsed >= self._seconds

    def before_substep(self) -> None:
        """Put it where it is now, until it has arrived."""
        if self.is_there:
            return
        share = min(self._elapsed / self._seconds, 1.0)
        frame = self._engine.geometry.between(self._start, self._goal, share)
        self._engine.put(self._body, frame, self._velocity, self._spin)

    def after_substep(self, seconds: float) -> None:
        """Move on, and look whether it has hit something that it did not touch before."""
        if self.is_there:
            return
        self._elapsed += seconds
        if self.blow is None:
            pressed = self._engine.contacts(self._body, are_pressed=True)
            new = [contact for contact in pressed if contact.other not in self._touched]
            if new:
                worst = max(new, key=lambda contact: contact.force)
                force = sum(contact.force for contact in new if contact.other == worst.other)
                self.blow = worst._replace(force=force)
        if self.is_there:
            self._engine.put(self._body, self._goal)


class Script(Remembers):
    """The actions of a run; each is executed once, in order of time.

    actions: in which `check_script` finds no mistakes. jammed: joint → the position it has been
    jammed at [rad]. moving: body → its motion, which is not saved. pushes: what is pushed. events:
    what has happened, one sentence each, until the plant has reported it.
    """

    remembers, parts = ("_done", "jammed"), ("pushes",)

    def __init__(
        self,
        actions: Sequence[Action],
        physics: Physics,
        cameras: Mapping[str, Camera],
        stop: StopSwitch,
        pushes: Pushes,
    ) -> None:
        self._physics = physics
        self.pushes = pushes
        self._cameras = cameras
        self._stop = stop
        self._actions = sorted(actions, key=lambda action: action.at_ns)
        self._done = 0
        self.events: list[str] = []
        self.jammed: dict[str, float] = {}
        self.moving: dict[str, MovingBody] = {}

    def move(self, t_ns: int, name: str, position: Point, yaw: float | None) -> None:
        """Move a body now, as a call asks; t_ns: the time [ns]."""
        rpy = None if yaw is None else (0.0, 0.0, yaw)
        self.record(t_ns, self._move_body(name, position, rpy))

    def run(self, t_ns: int) -> None:
        """Execute the actions that are due at a time [ns]."""
        if self.moving:
            self._report_blows(t_ns)
        actions = self._actions
        while self._done < len(actions) and actions[self._done].at_ns <= t_ns:
            action = actions[self._done]
            self._done += 1
            if action.emergency_stop is not None:
                self._stop.set(t_ns, "the script", self.record, active=action.emergency_stop)
            else:
                self.record(t_ns, self._execute(action))

    def record(self, t_ns: int, text: str) -> None:
        """Add what has happened at a time [ns]."""
        self.events.append(f"at {t_ns / 1e9:.9g} s: {text}")

    def _execute(self, action: Action) -> str:
        """Execute an action and return what has happened."""
        if action.body is not None and action.position is not None:
            return self._move_body(action.body, action.position, action.orientation_rpy)
        if action.body is not None and action.to is not None and action.over_ns is not None:
            return self._send_body(action.body, action.to, action.over_ns, action.orientation_rpy)
        if action.push is not None:
            return self.pushes.begin(action)
        if action.jam is not None:
            joint = self._physics.joints[action.jam]
            position = self.jammed.setdefault(joint.name, self._physics.state(joint)[0])
            return f"joint {joint.name} jammed at {position:.6g} {joint.unit}"
        off = action.off is not False
        self._cameras[str(action.camera)].is_on = not off
        return f"camera {action.camera} was switched {'off' if off else 'on'}"

    def _move_body(self, name: str, position: Point, rpy: Point | None) -> str:
        """Move a body, which is then at rest; its joints keep their positions."""
        engine, body = self._physics.engine, self._physics.bodies.index(name)
        rotation = engine.frame((body, BASE))[1] if rpy is None else quaternion(rpy)
        self.moving.pop(name, None)
        engine.put(body, (position, rotation))
        self._wake_all()
        target = ", ".join(f"{value:g}" for value in position)
        angles = "" if rpy is None else f", turned to {', '.join(f'{a:g}' for a in rpy)} rad"
        return f"{name} was put at {target} m{angles}{self._overlap(body)}"

    def _wake_all(self) -> None:
        """Wake all bodies: a sleeping one that lay on one that moves would stay in the air."""
        for number in range(len(self._physics.bodies)):
            self._physics.engine.wake(number)

    def _overlap(self, body: int) -> str:
        """Return the end of a sentence where a body has been put into another one."""
        engine = self._physics.engine
        engine.update_shapes()
        inside = [contact for contact in engine.contacts(body) if contact.distance < -_OVERLAP]
        if not inside:
            return ""
        deepest = min(inside, key=lambda contact: contact.distance)
        depth = f"{-deepest.distance * 1e3:.0f} mm"
        return f", {depth} into {self._names()[deepest.other]}"

    def _names(self) -> dict[Link, str]:
        return {link: name for name, link in self._physics.links.items()}

    def _send_body(self, name: str, goal: Point, over_ns: int, rpy: Point | None) -> str:
        """Let a body move from where it is."""
        engine, body = self._physics.engine, self._physics.bodies.index(name)
        rotation = engine.frame((body, BASE))[1] if rpy is None else quaternion(rpy)
        self.moving[name] = MovingBody(engine, body, (goal, rotation), over_ns * 1e-9)
        target = ", ".join(f"{value:g}" for value in goal)
        return f"{name} moves to {target} m in {format_duration(over_ns)}"

    def _report_blows(self, t_ns: int) -> None:
        """Report what moving bodies have hit, and forget those that have arrived."""
        names = self._names()
        for name, moving in list(self.moving.items()):
            if (blow := moving.blow) is not None and not moving.is_told:
                moving.is_told = True
                text = f"{names[blow.one]} hits {names[blow.other]} with {blow.force:.0f} N"
                self.record(t_ns, text)
            if moving.is_there:
                del self.moving[name]
        if self.moving:
            self._wake_all()

    def before_substep(self) -> None:
        """Hold the jammed joints; call it after the drives, whose motors it overrides."""
        for name, position in self.jammed.items():
            joint = self._physics.joints[name]
            goal = Goal(position, 0.0, _JAM_EFFORT, max_velocity=math.inf, gain=_JAM_GAIN)
            self._physics.engine.bring(joint.body, joint.index, goal)


def check_script(actions: Sequence[Action], physics: Physics, problems: Problems) -> None:
    """Add every name in a script that is not in the world; problems: of the plant's params."""
    known: dict[str, Collection[str]] = {"body": physics.bodies, "camera": physics.world.cameras}
    for number, action in enumerate(actions):
        for key, names in known.items():
            name = getattr(action, key)
            if name is not None and name not in names:
                text = f"{key} {name!r} is unknown{suggest(name, names)}"
                problems.add(("script", number, key), text)
        if action.push is not None:
            problems.attempt(("script", number, "push"), partial(find_link, physics, action.push))
        if action.jam is not None and (text := physics.lacks_joint(action.jam)):
            problems.add(("script", number, "jam"), f"joint {action.jam!r} {text}")
