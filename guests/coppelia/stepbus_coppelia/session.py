"""A script's session: its clients, its calls, and the steps that it lets the run make."""

import copy
import math
import os
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq

from stepbus_coppelia.clients import ApiError, Client, Endpoint
from stepbus_coppelia.drawings import Canvas
from stepbus_coppelia.functions import CONSTANTS, GROUPS
from stepbus_coppelia.joints import FREE, POSITION, Control, Group
from stepbus_coppelia.messages import BodyStates
from stepbus_coppelia.scene import JOINT, Scene, SceneObject
from stepbus_plant.geometry import Pose
from stepbus_plant.joint import Joint
from stepbus_plant.physics import Physics
from stepbus_schemas import JointCommand, JointState, RunError, WiringError

STOPPED, PAUSED, FIRST, RUNNING = 0, 8, 16, 17
"""Numbers of `sim.simulation_*`."""
PORT_VARIABLE = "STEPBUS_COPPELIA_PORT"
ENV = "env "
"""Before a program that is named by its path, as of /usr/bin/env: it is no file of a scenario."""
_WRONG = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, struct.error)
_TICK_S = 0.1
_LONGEST_CALL, _MOST_CALLS = 200, 75
"""Bytes of a call that is recorded, and different ones of a step: a step has 60 kB."""
_DENSITY = 500.0
"""Of a shape that a script has made, as in CoppeliaSim [kg/m³]."""
_FORMS = {"box": ("Cuboid", 1.0), "sphere": ("Sphere", 0.5236), "cylinder": ("Cylinder", 0.7854)}
"""Alias of a shape, and its part of the box around it."""


class ScriptFailed(RunError):
    """A script has ended with an error, or holds a step for too long."""


@dataclass(kw_only=True)
class Changes:
    """What a script has put somewhere, or lets a link hold.

    frames: body → where it is put. joints: joint → where it is put [rad]. held: body → link that
    holds it; empty: it is let go.
    """

    frames: dict[str, Pose] = field(default_factory=dict)
    joints: dict[str, float] = field(default_factory=dict)
    held: dict[str, str] = field(default_factory=dict)

    def fields(self) -> dict[str, Any]:
        """Return them as the fields of a `SceneChange`; empty: there are none."""
        if not (self.frames or self.joints or self.held):
            return {}
        return {
            "bodies": list(self.frames),
            "position": [frame[0] for frame in self.frames.values()],
            "orientation": [frame[1] for frame in self.frames.values()],
            "joints": list(self.joints),
            "joint_position": list(self.joints.values()),
            "held": list(self.held),
            "holders": list(self.held.values()),
        }


@dataclass
class Edits:
    """Changes of the plant's parameters, which the next simulation has.

    opened: returns the world with these. world: file of another world; empty: the scenario's.
    primitives, models, masses: as of `SceneParams`, as plain data. is_new: whether the scene does
    not show them yet.
    """

    opened: Callable[[Mapping[str, Any]], Physics]
    world: str = ""
    primitives: dict[str, dict[str, Any]] = field(default_factory=dict)
    models: dict[str, dict[str, Any]] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    is_new: bool = False

    def params(self) -> dict[str, Any]:
        """Return them as parameters of the plant."""
        rows = {"primitives": self.primitives, "models": self.models, "masses": self.masses}
        given: dict[str, Any] = {key: value for key, value in rows.items() if value}
        return given | ({"world": self.world} if self.world else {})


class Session:
    """What the clients of a script share: the scene, the simulation's state, and the next step.

    It outlives a simulation, so that a script can start another one. edits: what the next one has
    beside the world of the scenario. dt: length of a step [s]. params: of the gateway. functions:
    object whose methods scripts call as functions of other scripts. say: tells the user something.
    interrupted: whether the user wants to end.
    Raises ApiError for an alias or a sensor that names what is not in the world.
    """

    def __init__(
        self,
        edits: Edits,
        dt: float,
        params: Any,
        functions: object,
        *,
        say: Callable[[str], None],
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self.edits, self.dt, self.params, self.lua = edits, dt, params, functions
        self.scene = scene = Scene(edits.opened({}), params.aliases, params.proximity_sensors)
        self.say, self._interrupted = say, interrupted
        self.clients: list[Client] = []
        self.endpoints: list[Endpoint] = []
        self.state, self.step, self.time = STOPPED, 0, 0.0
        self.client = Client("")
        self._functions = {
            name: getattr(group, work)
            for group in (kind(self) for kind in GROUPS)
            for name, work in group.names().items()
        }
        self.signals: dict[str, Any] = {}
        self.unanswered, self.calls = Counter[str](), Counter[str]()
        self.initial, self.changes = Changes(), Changes()
        self.values: dict[tuple[str, int], Any] = {}
        self.logged: list[tuple[str, str]] = []
        self.controls = {name: Control.of(j) for name, j in scene.physics.joints.items()}
        self.groups: Mapping[str, Group] = {}
        self.is_ending = self.has_clients = False
        self.runs, self.port = 0, 0
        self.drawings = Canvas()
        self.collections: dict[int, list[SceneObject]] = {}
        self._kept, self._order = set[int](), list[int]()
        self._due_s = self._begun_s = self._look_s = 0.0
        self._left = ""
        self._script: subprocess.Popen[bytes] | None = None
        self._poller = zmq.Poller()
        self._sockets: dict[Any, Endpoint] = {}

    # --- who speaks to it -----------------------------------------------------------------

    def listen(self, endpoint: Endpoint) -> None:
        """Take clients of a further API."""
        self.endpoints.append(endpoint)
        for socket in endpoint.sockets():
            self._poller.register(socket, zmq.POLLIN)
            # The poller names those that are none of ZeroMQ's by their number.
            self._sockets[socket if isinstance(socket, zmq.Socket) else socket.fileno()] = endpoint

    def start_script(self, command: Sequence[str], folder: Path, port: int) -> None:
        """Start the program of the user, if there is one; its output is that of this process."""
        self.port = port
        if not command:
            return
        program = sys.executable if command[0] == "python" else command[0].removeprefix(ENV)
        words, env = [program, *command[1:]], {**os.environ, PORT_VARIABLE: str(port)}
        try:
            self._script = subprocess.Popen(words, cwd=folder, env=env)
        except OSError as exc:
            is_text = Path(program).suffix in (".py", ".m")
            hint = f"; name what runs it, as in `-- python {command[0]}`" if is_text else ""
            raise ScriptFailed(f"cannot start {command[0]}: {exc.strerror}{hint}") from exc

    def join(self, client: Client) -> None:
        """Take a new connection."""
        self.clients.append(client)
        self.has_clients = True

    def leave(self, client: Client, why: str) -> None:
        """Forget a connection that is gone; why: as the end of a sentence about it."""
        if client in self.clients:
            self.clients.remove(client)
            self._left = f"{client.name} {why or 'has left'}"
            if why:
                self.say(f"{client.name} {why}")

    # --- its calls ------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Return whether a simulation goes on, paused or not."""
        return self.state != STOPPED

    def call(self, client: Client, name: str, args: list[Any]) -> list[Any]:
        """Call a function by its name without `sim.`; return its results. Raises ApiError."""
        where = f"in sim.{name}"
        if (work := self._functions.get(name)) is None:
            self.unanswered[name] += 1
            raise ApiError(f"{where}: this function is not available in stepbus.")
        self.client = client
        if client.is_recorded:
            text = f"{client.name}: {name}({ascii(args)[1:-1]})"[:_LONGEST_CALL]
            text = text if text in self.calls or len(self.calls) < _MOST_CALLS else "further calls"
            self.calls[text] += 1
        try:
            self._settle()
            result = work(*args)
        except ApiError as exc:
            raise ApiError(f"{where}: {exc}") from None
        except _WRONG as exc:
            raise ApiError(f"{where}: bad arguments ({exc}).") from None
        results = result if isinstance(result, tuple) else (result,)
        return [] if result is None else list(results)

    def _settle(self) -> None:
        """Let the scene show what has changed since it was last asked."""
        if self.edits.is_new:
            self.edits.is_new, before = False, self.scene.physics
            self.scene.build(self.edits.opened(self.edits.params()))
            before.close()
            self._restore()
        self.scene.settle()

    def _restore(self) -> None:
        """Put everything where the script has put it before the simulation, undriven."""
        self.controls = {name: Control.of(j) for name, j in self.scene.physics.joints.items()}
        for body, frame in self.initial.frames.items():
            if body in self.scene.physics.bodies:
                self.scene.engine.put(self.scene.physics.bodies.index(body), frame)
        for name, value in self.initial.joints.items():
            self.scene.put_joint(self.scene.physics.joints[name], value)

    @property
    def moment(self) -> tuple[int, int]:
        """Return what an image is of: the simulation, and its step."""
        return self.runs, self.step

    @property
    def _noted(self) -> Changes:
        """Return where a change is noted; one before the simulation counts in each."""
        return self.changes if self.is_running else self.initial

    def put(self, thing: SceneObject, pose: Pose) -> None:
        """Put an object somewhere in the world."""
        self.scene.move(thing, pose)
        if thing.is_root:
            self._noted.frames[self.scene.body(thing)] = pose

    def put_joint(self, joint: Joint, position: float) -> None:
        """Put a joint somewhere [rad]."""
        self.scene.put_joint(joint, position)
        self._noted.joints[joint.name] = position

    def hold(self, thing: SceneObject, holder: SceneObject | None) -> None:
        """Let a body go along with what another object is on; None: let it go."""
        while holder is not None and holder.link is None:
            holder = self.scene.objects.get(holder.parent)
        names = {link: name for name, link in self.scene.physics.links.items()}
        link = None if holder is None else holder.link
        self._noted.held[self.scene.body(thing)] = "" if link is None else names[link]

    def make_shape(self, kind: str, size: list[float]) -> int:
        """Make a box, sphere or cylinder [m]; return its handle."""
        if min(size) <= 0.0:
            raise ApiError(f"sizes must be above 0 m, not {min(size):g}.")
        (alias, part), known = _FORMS[kind], self.edits.primitives
        mass = _DENSITY * (size[0] * size[1] * size[2] * part)
        made = self._add_body(alias, known, known, {"kind": kind, "size": size, "mass": mass})
        made.alias = alias
        return made.handle

    def load_model(self, urdf: str, name: str) -> int:
        """Add a body from a model file; return its handle."""
        known = self.edits.models
        made = self._add_body(name, {*known, *self.scene.physics.bodies}, known, {"urdf": urdf})
        self._show(lambda: self.remove(made))
        return made.handle

    def _add_body(
        self, stem: str, taken: Collection[str], rows: dict[str, Any], row: dict[str, Any]
    ) -> SceneObject:
        self._must_be_stopped()
        names = [stem, *(f"{stem}{number}" for number in range(len(taken) + 1))]
        name = next(name for name in names if name not in taken)
        rows[name], self.edits.is_new = row, True
        return self.scene.add_shape(name)

    def shape_changed(self, handle: int, **changes: Any) -> None:
        """Change the mass [kg], colour, or other keys of `Primitive` of a shape."""
        thing, edits = self.scene.get(handle), self.edits
        if changes.get("mass", 1.0) <= 0.0:
            raise ApiError(f"the mass must be above 0 kg, not {changes['mass']:g}.")
        is_made = thing.name in edits.primitives
        if "mass" in changes and not (is_made or self._is_one_link(thing)):
            raise ApiError(f"{self.scene.path(thing)} is a robot, whose masses are in its model.")
        if self.is_running and changes.keys() == {"mass"}:
            text = f"{self.scene.path(thing)} has its new mass from the next simulation on"
            self.logged.append(("warning", text))
        elif changes.keys() != {"colour"}:
            self._must_be_stopped()
        if (row := edits.primitives.get(thing.name)) is not None:
            row |= changes
        elif "mass" in changes:
            edits.masses[thing.name] = changes["mass"]
        thing.values |= changes
        # While it runs, the scene shows the bodies of the plant, which has begun.
        is_new = edits.is_new or row is not None or "mass" in changes
        edits.is_new = is_new and not self.is_running

    def _is_one_link(self, thing: SceneObject) -> bool:
        """Return whether an object is a body of one link with a mass, as an item of a world is."""
        if not thing.is_root or thing.link is None:
            return False
        robot = self.scene.physics.robots[thing.link[0]]
        inertial = robot.links[robot.root].inertial
        return len(robot.links) == 1 and inertial is not None and inertial.mass > 0.0

    def remove(self, thing: SceneObject) -> None:
        """Remove what the script has made."""
        if thing.is_model:
            self._must_be_stopped()
        edits = self.edits
        known = edits.primitives if thing.name in edits.primitives else edits.models
        if known.pop(thing.name, None) is None and (thing.link is not None or thing.kind == JOINT):
            text = "is part of the world, and cannot be removed."
            raise ApiError(f"{self.scene.path(thing)} {text}")
        edits.masses.pop(thing.name, None)
        edits.is_new = edits.is_new or thing.is_model
        self.scene.remove(thing)

    def load_scene(self, world: str) -> None:
        """Take another world; empty: that of the scenario."""
        self._must_be_stopped()
        before = self.edits, self.initial
        self.edits, self.initial = Edits(before[0].opened, world, is_new=True), Changes()

        def undo() -> None:
            self.edits, self.initial = before

        self._show(undo)

    def _show(self, undo: Callable[[], object]) -> None:
        """Let the scene show a change at once, or undo it; raises ApiError, which says why not."""
        before = self.scene.physics
        try:
            self._settle()
        except (ApiError, WiringError) as exc:
            undo()
            self.edits.is_new = False
            if self.scene.physics is not before:
                self.scene.build(before)
            raise ApiError(str(exc)) from exc

    def _must_be_stopped(self) -> None:
        if self.is_running:
            text = "make and change bodies before sim.startSimulation."
            raise ApiError(f"the simulation is running; {text}")

    def velocity_of(self, thing: SceneObject) -> tuple[Any, Any]:
        """Return velocity [m/s] and angular velocity [rad/s] of an object in the world."""
        linear, angular = self.scene.velocity_of(thing)
        return list(linear), list(angular)

    def property_of(self, thing: SceneObject, parameter: int) -> float:
        """Return a property by CoppeliaSim's number, as the script has set it, or as it is."""
        own: dict[str, float] = {}
        if (joint := thing.joint) is not None:
            control, velocity = self.controls[joint.name], self.scene.velocity
            own = {
                "jointintparam_dynctrlmode": control.mode,
                "jointintparam_motor_enabled": control.mode != FREE,
                "jointintparam_ctrl_enabled": control.mode == POSITION,
                "jointfloatparam_velocity": velocity[self.scene.joint_index[joint.name]],
                "jointfloatparam_upper_limit": min(joint.upper, math.pi),
                "jointfloatparam_maxvel": min(control.fastest, sys.float_info.max),
            }
        elif thing.camera is not None:
            row = thing.camera.row
            larger = math.tan(row.fov / 2) * max(row.width / row.height, 1.0)
            own = {
                "visionintparam_resolution_x": row.width,
                "visionintparam_resolution_y": row.height,
                "visionfloatparam_perspective_angle": 2.0 * math.atan(larger),
                "visionfloatparam_near_clipping": row.near,
                "visionfloatparam_far_clipping": row.far,
            }
        elif thing.is_root:
            own["shapeintparam_static"] = self.scene.physics.world.bodies[thing.name].fixed_base
        known = {CONSTANTS[name]: value for name, value in own.items()}
        return float(known.get(parameter, thing.values.get(str(parameter), 0.0)))

    # --- its simulations ------------------------------------------------------------------

    def start(self) -> None:
        """Start a simulation, or go on with one that is paused."""
        if self.state == PAUSED:
            self.state = RUNNING
        elif self.state == STOPPED:
            self._settle()
            self.state, self.step, self.time, self.runs = FIRST, 0, 0.0, self.runs + 1
            self._kept = set(self.scene.objects)
            self.changes = copy.deepcopy(self.initial)
            for control in self.controls.values():
                control.is_new = True
        self._due_s = time.monotonic()

    def stop(self) -> None:
        """Stop the simulation; all stepping ends with it."""
        if self.state != STOPPED:
            self.state, self.is_ending = STOPPED, True
            for client in self.clients:
                client.level = 0
            self._answer()
            for handle in self.scene.objects.keys() - self._kept:
                # What is made while it runs does not outlive it.
                self.scene.remove(self.scene.objects[handle])
            self.scene.reset()
            self._restore()

    def pause(self) -> None:
        """Hold the simulation until it is started again."""
        if self.state != STOPPED:
            self.state = PAUSED

    def connect(self, groups: Mapping[str, Group], names: Sequence[str], bodies: list[str]) -> None:
        """Take what a run has: the joints of each command, and of the messages of the plant."""
        self.groups = groups
        self.scene.body_names = bodies
        self._order = [self.scene.joint_index[name] for name in names]

    def take(self, step: int, state: JointState | None, bodies: BodyStates | None) -> None:
        """Take the state of the plant at a step, and answer those that have waited for it."""
        self.time += self.dt * (step - self.step)
        self.step = step
        # As the scripts of CoppeliaSim's own scenes do for clients of the legacy API.
        self.signals["legacyRemoteApiStepCounter"] = step
        if state is not None:
            self.scene.take(state, self._order, bodies)
        if step:
            # Who has asked for a step before the first one waits for that.
            self.state = RUNNING if self.state == FIRST else self.state
            self._answer()

    def _answer(self) -> None:
        for client in self.clients:
            client.waits = client.waits and self.is_running and self.time < client.until - 1e-9
        for endpoint in self.endpoints:
            endpoint.stepped()

    def commands(self) -> dict[str, JointCommand]:
        """Return the commands of this step, by port: those that are new."""
        return {
            port: group.command(self.controls, self.scene)
            for port, group in self.groups.items()
            if any(self.controls[name].is_new for name in group.names)
        }

    def serve_until_started(self) -> bool:
        """Answer calls until a simulation is started; return False when no client is left."""
        told = time.monotonic() + 10.0
        while not self.is_running:
            if self.params.start and self.has_clients and not self.runs:
                self.start()
            elif self._interrupted() or not self._serve(_TICK_S):
                return False
            if told and time.monotonic() > told:
                told = 0.0
                ports = " or ".join(str(endpoint.port) for endpoint in self.endpoints)
                who = f"no script has connected to port {ports}"
                who = "the script has connected" if self.has_clients else who
                who = "the script goes on after its simulation" if self.runs else who
                self.say(f"waiting for sim.startSimulation; {who}")
        return True

    def serve_step(self) -> str:
        """Answer calls until the next step may begin; return why the run ends, or an empty text.

        Raises ScriptFailed when the script has failed, or a client holds the step for too long.
        """
        self._begun_s = time.monotonic()
        self._due_s = max(self._due_s + self.dt, self._begun_s - self.dt)
        while True:
            if self.is_ending:
                self.is_ending, has_stopped = False, self.state == STOPPED
                self.state = STOPPED
                return "sim.stopSimulation" if has_stopped else self._left
            if self._interrupted():
                return "interrupted"
            wait_s = self._wait_s()
            if not self._serve(max(wait_s, 0.0)):
                self.state = STOPPED
                return "the script has ended" if self._script else self._left
            if wait_s <= 0.0 and self._wait_s() <= 0.0 and not self.is_ending:
                return ""

    def _wait_s(self) -> float:
        """Return how long to wait for calls before this step is looked at again [s]; 0: it is due.

        Raises ScriptFailed when a client holds the step for too long.
        """
        stepping = [client for client in self.clients if client.level > 0]
        holders = [client for client in stepping if not client.waits]
        # When the last one has left, it is awaited how its script ends.
        if self.state == PAUSED or holders or (self.has_clients and not self.clients):
            held_s = time.monotonic() - self._begun_s
            is_late = held_s > self.params.client_timeout_ns * 1e-9
            if is_late and (holders or self.state == PAUSED):
                who = "the simulation has been paused"
                if self.state != PAUSED:
                    who = f"{holders[0].name} steps the simulation, and has not asked for a step"
                hint = "if it needs that long, set --client-timeout"
                raise ScriptFailed(f"{who} for {held_s:.0f} s; {hint}")
            self.is_ending = self.is_ending or is_late
            return _TICK_S
        return 0.0 if stepping else self._due_s - time.monotonic()

    def _serve(self, wait_s: float) -> bool:
        """Answer what arrives within a time; return whether anybody may still call."""
        for socket, _ in self._poller.poll(math.ceil(min(wait_s, _TICK_S) * 1e3)):
            self._sockets[socket].receive(socket)
        now = time.monotonic()
        if now < self._look_s:
            return True
        self._look_s = now + _TICK_S / 2
        if (script := self._script) is None:
            return bool(self.clients) or not self.has_clients
        if (code := script.poll()) and not self._interrupted():
            how = f"exit code {code}" if code > 0 else f"signal {-code}"
            raise ScriptFailed(f"the script has ended with {how}; see its output")
        return code is None

    def close(self) -> None:
        """End the script, and all connections."""
        for endpoint in self.endpoints:
            endpoint.close()
        if self._script is not None and self._script.poll() is None:
            self._script.terminate()
            try:
                self._script.wait(2.0)
            except subprocess.TimeoutExpired:
                self._script.kill()
                self._script.wait()  # no time-out: it has been killed
