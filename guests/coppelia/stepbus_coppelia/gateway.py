"""The gateway: takes part in a run on behalf of a script that speaks CoppeliaSim's remote API."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_coppelia.edits import Changes, EditedScene
from stepbus_coppelia.joints import groups_of
from stepbus_coppelia.legacy.server import LegacyEndpoint
from stepbus_coppelia.params import Params
from stepbus_coppelia.plant import BODIES, CHANGES, SceneParams
from stepbus_coppelia.scene_plant import scene_world
from stepbus_coppelia.session import ScriptFailed, Session
from stepbus_coppelia.zmq_api import ZmqEndpoint
from stepbus_participant import Config, Participant, Problems, Step, StepsOver, load_class, warn
from stepbus_plant import load_world
from stepbus_plant.physics import Physics
from stepbus_schemas import Description, Event, JointState, Message, WiringError

STATE, EVENTS, CALLS, DRAWINGS = "joint_state", "events", "calls", "drawings"
"""Ports, beside those of the commands, and `changes` and `bodies` of the plant."""
_MOST_TEXT = 500
"""Characters of a message of a script; all of a step have ten times as many."""
shared: Session | None = None
"""Of the command in this process, which outlives a run."""


def open_session(
    params: Params, step_ns: int, folder: Path, script: tuple[Sequence[str], Path], **how: Any
) -> Session:
    """Return a session that listens, with its script started.

    step_ns: length of a step [ns]. folder: of the scenario. script: its command line, and
    the folder in which it starts. how: further arguments of `Session`. Raises WiringError.
    """

    def opened(changes: Mapping[str, Any]) -> Physics:
        problems = Problems(above=("participants", "plant", "params"))
        own = SceneParams.of({**params.plant, **changes}, folder)
        world = scene_world(load_world(own.world, own.stock, problems, seed=params.plant_seed), own)
        physics = Physics(world, step_ns, own, problems)
        problems.refuse()
        return physics

    functions = load_class(params.functions, folder)() if params.functions else None
    scene = EditedScene(opened, params.aliases, params.proximity_sensors)
    session = Session(scene, step_ns * 1e-9, params, functions, **how)
    try:
        session.listen(ZmqEndpoint(session, port := params.port))
        for port in params.legacy_ports:
            session.listen(LegacyEndpoint(session, port))
        session.start_script(*script)
    except BaseException as exc:
        session.close()
        if isinstance(exc, OSError):
            text = f"cannot listen on port {port} of this machine: {exc.strerror}"
            hint = "is V-REP running? Choose others with --legacy-port"
            raise WiringError(f"{text}; {hint}") from exc
        raise
    return session


class Gateway(Participant):
    """Lets a script step a run, and turns its calls into commands; `stepbus coppelia` adds it.

    Inputs: `joint_state` and `bodies` of the plant. Outputs: a JointCommand/1 for the joints of
    each body that have the same mode, `changes` (SceneChange/1), `calls` (RemoteCalls/1),
    `drawings` (Drawings/1), `events` (Event/1).
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        params, folder = config.read(Params), config.folder
        if STATE not in config.inputs:
            text = "run this scenario with `stepbus coppelia`, which connects the gateway"
            raise WiringError(text)
        script = params.command, folder
        self._session = shared or open_session(params, config.step_ns, folder, script, say=warn)
        physics = self._session.scene.physics
        self._groups = groups_of(physics.joints, physics.bodies, config.step_ns * 1e-9)
        self._is_own, self._has_ended = shared is None, False
        # Here, since a script may take longer to start than it may for a step.
        if self._is_own and not self._session.serve_until_started():
            raise ScriptFailed("the script has ended, and has not started the simulation")
        # Messages are of the types of the run, which these classes have declared.
        self._classes = {port: config.types[row.type] for port, row in config.outputs.items()}

    def describe(self) -> dict[str, Description]:
        """Return the joints of each command."""
        names = {port: list(group.names) for port, group in self._groups.items()}
        return {port: Description(names=names.get(port, [])) for port in self.config.outputs}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take the order of joints and bodies in the plant's messages."""
        bodies = inputs[BODIES].names if BODIES in inputs else []
        self._session.scene.connect(self._groups, inputs[STATE].names, bodies)

    def update(self, step: Step) -> dict[str, Message]:
        """Answer the script until the next step may begin; return what it has commanded."""
        session = self._session
        if self._has_ended:
            raise StepsOver
        bodies = step.get(BODIES) if BODIES in self.config.inputs else None
        session.take(step.index, step.get(STATE, JointState), bodies)
        if why := session.serve_step():
            step.end(why)
            self._has_ended = True
        messages: dict[str, Message] = {**session.scene.commands()}
        own = {CHANGES: session.scene.changes.fields(), DRAWINGS: session.drawings.fields()}
        if calls := session.calls:
            own[CALLS] = {"calls": list(calls), "times": list(calls.values())}
        session.scene.changes, session.calls = Changes(), Counter()
        is_first = step.index == 0
        messages |= {p: self._classes[p](**row) for p, row in own.items() if row or is_first}
        if session.logged:
            levels = {level for level, _ in session.logged}
            level: Any = next(name for name in ("error", "warning", "info") if name in levels)
            text = "\n".join(text[:_MOST_TEXT] for _, text in session.logged)[: 10 * _MOST_TEXT]
            messages[EVENTS], session.logged = Event(level=level, text=text), []
        return messages

    def close(self) -> None:
        """End the script, unless it goes on after this run."""
        if self._is_own:
            self._session.close()
