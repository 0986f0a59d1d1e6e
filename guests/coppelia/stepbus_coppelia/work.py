"""`stepbus coppelia`: connects a script to the plant of a scenario, and runs what it starts."""

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from stepbus_coppelia import gateway
from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.declared import Coppelia
from stepbus_coppelia.gateway import CALLS, DRAWINGS, EVENTS, STATE, open_session
from stepbus_coppelia.joints import groups_of
from stepbus_coppelia.params import Params
from stepbus_coppelia.plant import BODIES, CHANGES
from stepbus_coppelia.session import ENV, ScriptFailed, Session
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.run_command import after_run, summary
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, print_error
from stepbus_orchestrator.cli.viewer import viewed
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.folder import default_folder
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.kernel.admission import participant_seed
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import named_from
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import format_duration
from stepbus_participant.parameters import parse_yaml
from stepbus_plant.engine import BASE
from stepbus_schemas import WiringError

GATEWAY = "stepbus_coppelia:Gateway"
PLANT, SCENE_PLANT = "stepbus_plant:Plant", "stepbus_coppelia.plant:ScenePlant"
_OUTPUTS = {CHANGES: "SceneChange/1", DRAWINGS: "Drawings/1"}
_OUTPUTS |= {CALLS: "RemoteCalls/1", EVENTS: "Event/1"}
_SLACK_NS = 5_000_000_000
"""By which the deadline of the gateway is longer than that of its clients [ns]."""


class Stage:
    """A scenario with the gateway in it.

    given: the options. gateway, plant: the rows of both, plain. params: of the gateway.
    Raises WiringError for a scenario without a plant, or with several.
    """

    def __init__(self, given: Coppelia) -> None:
        self.scenario = loaded = load(given.scenario, given.set)
        self._content: dict[str, Any] = parse_yaml("scenario", resolved(loaded))
        if not any(text.startswith("duration=") for text in given.set):
            # The script says when it is over.
            self._content.pop("duration", None)
        rows: dict[str, dict[str, Any]] = self._content["participants"]
        plants = [n for n, row in rows.items() if row.get("participant") in (PLANT, SCENE_PLANT)]
        if len(plants) != 1:
            raise WiringError(f"{loaded.name} has {len(plants)} plants; a script needs one")
        own = [n for n, row in rows.items() if row.get("participant") == GATEWAY]
        self.plant, self.name = plants[0], own[0] if own else "script"
        before = rows[own[0]].get("params", {}) if own else {}
        self._kept = {n: row for n, row in rows.items() if n not in (*own, self.plant) and own}
        self._row = rows[self.plant]
        # A script may ask for any joint.
        self._row.get("params", {}).pop("joints", None)
        program, words = "".join(given.script[:1]), given.script[1:]
        # A rerun finds files by their place beside the scenario, and programs where they are.
        files = {word: Path(word).absolute() for word in words if Path(word).is_file()}
        paths = [str(files.get(word, word)) for word in words]
        command = [named_from(loaded.folder, "script.command", word) for word in paths]
        first = f"{ENV}{program}" if "/" in program else program
        command = [first, *command] if program else []
        # What a script imports is beside it.
        near = [(os.path.relpath(p.parent, loaded.folder), p.suffix) for p in files.values()][:1]
        beside = [f"{folder}/*{suffix}" for folder, suffix in near]
        self._files = [*rows.get(self.name, {}).get("files", []), *beside]
        options = {"command": command, "client_timeout": given.client_timeout, "start": given.start}
        self._params: dict[str, Any] = {
            **before,
            **{key: value for key, value in options.items() if value},
            "port": given.port,
            **({"legacy_ports": given.legacy_port} if given.legacy_port else {}),
            "plant": self._row.get("params", {}),
            "plant_seed": participant_seed(loaded.seed, self.plant),
        }
        self.params = Params.of(self._params, loaded.folder)

    def scenario_of(self, session: Session, number: int) -> Scenario:
        """Return the scenario of a run; number: of the simulation, from 1 on."""
        physics, plant, edits = session.scene.physics, self.plant, session.scene.edits.params()
        commands = groups_of(physics.joints, physics.bodies, session.dt)
        rows = self._row.get("outputs", {}).items()
        outputs = {port: row for port, row in rows if _type(row) != "JointState/1"}
        outputs[STATE] = "JointState/1"
        given = {**self._row.get("params", {}), **edits}
        has_joints = {joint.body for joint in physics.joints.values()}
        bodies = list(enumerate(physics.world.bodies.values()))
        shown = [n for n, body in bodies if not body.fixed_base or n not in has_joints]
        if shown and "Poses/1" not in map(_type, outputs.values()):
            # Where views and reports find what a script moves.
            names = {link: name for name, link in physics.links.items()}
            outputs["poses"] = "Poses/1"
            given.setdefault("poses", [names[n, BASE] for n in shown])
        inputs = {STATE: f"{plant}.{STATE}"}
        if not all(body.fixed_base for _, body in bodies):
            outputs[BODIES], inputs[BODIES] = "BodyStates/1", f"{plant}.{BODIES}"
        params = {**self._params, "plant": {**self._params["plant"], **edits}}
        if number > 1:
            # A script begins with its first simulation: it cannot repeat this one alone.
            params.pop("command", None)
        types = self._content.get("types", [])
        own = types if isinstance(types, list) else [types]
        content = {
            **self._content,
            "types": [*own, "stepbus_coppelia.messages"],
            "participants": {
                plant: {
                    **self._row,
                    "participant": SCENE_PLANT,
                    "publishes": "first",
                    "inputs": {port: f"{self.name}.{port}" for port in (*commands, CHANGES)},
                    "outputs": outputs,
                    "params": given,
                },
                self.name: {
                    "participant": GATEWAY,
                    "inputs": inputs,
                    "outputs": {**dict.fromkeys(commands, "JointCommand/1"), **_OUTPUTS},
                    "params": params,
                    "files": self._files,
                    "step_timeout": format_duration(self.params.client_timeout_ns + _SLACK_NS),
                },
                **self._kept,
            },
        }
        return load(content, folder=self.scenario.folder)


def _type(row: Any) -> str:
    return row if isinstance(row, str) else str(row["type"])


def coppelia_command(given: Coppelia) -> int:
    """Run every simulation that a script starts, and return the exit code of the last one."""
    stage = Stage(given)
    with interruptible(ends=True) as interrupt:
        base, script = stage.scenario, (given.script, Path.cwd())
        how = {"say": _say, "interrupted": interrupt.is_set}
        try:
            session = open_session(stage.params, base.step_ns, base.folder, script, **how)
        except ApiError as exc:
            raise WiringError(str(exc)) from exc
        gateway.shared = session
        try:
            port, *old = [str(endpoint.port) for endpoint in session.endpoints]
            legacy = f"; legacy API (simx) on {', '.join(old)}" if old else ""
            hint = "" if given.script else "; start your script"
            _say(f"listening on 127.0.0.1:{port}{legacy}{hint}")
            code = _simulations(given, stage, session, interrupt)
        except ScriptFailed as exc:
            print_error(str(exc))
            code = ExitCode.FAULT
        finally:
            gateway.shared = None
            session.close()
        if session.unanswered:
            rows = [f"  sim.{name}, {count}×" for name, count in session.unanswered.items()]
            _say("\n".join(["functions that are not available:", *rows]))
        if not (session.runs or code):
            text = "the script has not started a simulation (sim.startSimulation, or --start)"
            is_over = interrupt.is_set()
            print_error("interrupted by the user" if is_over else f"{text}: nothing was run")
            return ExitCode.INTERRUPTED if is_over else ExitCode.FAULT
    return ExitCode.INTERRUPTED if interrupt.is_set() and not code else code


def _simulations(given: Coppelia, stage: Stage, session: Session, interrupt: Any) -> int:
    code = 0
    while not code and session.serve_until_started():
        scenario = stage.scenario_of(session, session.runs)
        out = given.out or default_folder(scenario, Path("runs"))
        if given.out and session.runs > 1:
            out = Path(f"{out}-{session.runs}")
        with ExitStack() as stack:
            if given.view:
                view = viewed(out, opens=not given.no_open, stays=False, interrupt=interrupt)
                stack.enter_context(view)
            shown = stack.enter_context(displayed(scenario.name, quiet=False))
            result = run(scenario, Options(out=out, host=InProcess()), shown, interrupt)
        session.stop()
        session.is_ending = False
        lines = after_run(result, has_plots=not given.no_report, is_interrupted=interrupt.is_set())
        error = result.reason if result.exit_code else ""
        Answer(value=result, lines=summary(result, lines), error=error).show(as_json=False)
        code = result.exit_code
    return code


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
