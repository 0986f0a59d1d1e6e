"""A script's session: its clients, its calls, and the steps that it lets the run make."""

import math
import os
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import zmq

from stepbus_coppelia.clients import ApiError, Client, Endpoint
from stepbus_coppelia.drawings import Canvas
from stepbus_coppelia.edits import EditedScene
from stepbus_coppelia.functions import GROUPS
from stepbus_coppelia.messages import BodyStates
from stepbus_coppelia.scene import SceneObject
from stepbus_schemas import JointState, RunError

STOPPED, PAUSED, FIRST, RUNNING = 0, 8, 16, 17
"""Numbers of `sim.simulation_*`."""
PORT_VARIABLE = "STEPBUS_COPPELIA_PORT"
ENV = "env "
"""Before a program that is named by its path, as of /usr/bin/env: it is no file of a scenario."""
_WRONG = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, struct.error)
_TICK_S = 0.1
_LONGEST_CALL, _MOST_CALLS = 200, 75
"""Bytes of a call that is recorded, and different ones of a step: a step has 60 kB."""


class ScriptFailed(RunError):
    """A script has ended with an error, or holds a step for too long."""


class Session:
    """What the clients of a script share: the scene, the simulation's state, and the next step.

    It outlives a simulation, so that a script can start another one. scene: as it begins. dt:
    length of a step [s]. params: of the gateway. functions: object whose methods scripts call as
    functions of other scripts. say: tells the user something. interrupted: whether the user wants
    to end.
    """

    def __init__(
        self,
        scene: EditedScene,
        dt: float,
        params: Any,
        functions: object,
        *,
        say: Callable[[str], None],
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self.scene, self.dt, self.params, self.lua = scene, dt, params, functions
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
        self.values: dict[tuple[str, int], Any] = {}
        self.logged: list[tuple[str, str]] = []
        self.is_ending = self.has_clients = False
        self.runs, self.drawings = 0, Canvas()
        self.collections: dict[int, list[SceneObject]] = {}
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

    def start_script(self, command: Sequence[str], folder: Path) -> None:
        """Start the program of the user, if there is one; its output is that of this process."""
        if not command:
            return
        program = sys.executable if command[0] == "python" else command[0].removeprefix(ENV)
        env = {**os.environ, PORT_VARIABLE: str(self.endpoints[0].port)}
        try:
            self._script = subprocess.Popen([program, *command[1:]], cwd=folder, env=env)
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
            self.scene.settle()
            result = work(*args)
        except ApiError as exc:
            raise ApiError(f"{where}: {exc}") from None
        except _WRONG as exc:
            raise ApiError(f"{where}: bad arguments ({exc}).") from None
        results = result if isinstance(result, tuple) else (result,)
        return [] if result is None else list(results)

    # --- its simulations ------------------------------------------------------------------

    def start(self) -> None:
        """Start a simulation, or go on with one that is paused."""
        if self.state == PAUSED:
            self.state = RUNNING
        elif self.state == STOPPED:
            self.scene.begin()
            self.state, self.step, self.time, self.runs = FIRST, 0, 0.0, self.runs + 1
        self._due_s = time.monotonic()

    def stop(self) -> None:
        """Stop the simulation; all stepping ends with it."""
        if self.state != STOPPED:
            self.state, self.is_ending = STOPPED, True
            for client in self.clients:
                client.level = 0
            self._answer()
            self.scene.end()

    def pause(self) -> None:
        """Hold the simulation until it is started again."""
        if self.state != STOPPED:
            self.state = PAUSED

    def take(self, step: int, state: JointState | None, bodies: BodyStates | None) -> None:
        """Take the state of the plant at a step, and answer those that have waited for it."""
        self.time += self.dt * (step - self.step)
        self.step = step
        # As the scripts of CoppeliaSim's own scenes do for clients of the legacy API.
        self.signals["legacyRemoteApiStepCounter"] = step
        if state is not None:
            self.scene.take(state, bodies)
        if step:
            # Who has asked for a step before the first one waits for that.
            self.state = RUNNING if self.state == FIRST else self.state
            self._answer()

    def _answer(self) -> None:
        for client in self.clients:
            client.waits = client.waits and self.is_running and self.time < client.until - 1e-9
        for endpoint in self.endpoints:
            endpoint.stepped()

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
