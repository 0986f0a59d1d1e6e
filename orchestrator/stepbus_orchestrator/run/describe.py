"""What the participants of a scenario say of themselves, before any step."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, Schedule
from stepbus_schemas import Description

from .kernel.descriptions import input_descriptions
from .kernel.participants import Participants
from .kernel.state import RunState
from .options import Options
from .run_scenario import run_with
from .strategy import Strategy

_JOINT_STATE = "JointState/1"
_WITHOUT_MOTOR = ("passive", "teleport")


class InputPort(msgspec.Struct, frozen=True, kw_only=True):
    """One input. source: `participant.output`. delay: how old it is at least [steps]."""

    port: str
    type: str
    source: str
    delay: int


class JointRow(msgspec.Struct, frozen=True, kw_only=True):
    """One joint of a joint state.

    index: its place in every vector of the port. type, mode: as its participant calls them; empty
    where it does not say. lower, upper: stops [rad]; velocity [rad/s] and effort [N·m]: limits;
    None: not said; an infinite one does not exist. motor: whether anything can drive it; None
    where neither mode nor effort are said. Prismatic joints have [m] and [N].
    """

    index: int
    name: str
    type: str
    mode: str
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    motor: bool | None


class OutputPort(msgspec.Struct, frozen=True, kw_only=True):
    """One output.

    taken_by: inputs that read it, as `participant.input`. joints: of a joint state, and none else.
    """

    port: str
    type: str
    taken_by: list[str]
    description: Description
    joints: list[JointRow] = []


class Portrait(msgspec.Struct, frozen=True, kw_only=True):
    """One participant: its ports, and what it says of each output."""

    participant: str
    inputs: list[InputPort]
    outputs: list[OutputPort]


class DescribeFailed(RunFailure):
    """The participants did not get as far as describing themselves; `code` is that of the run."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = ExitCode(code)


def describe(scenario: Scenario, interrupt: threading.Event | None = None) -> list[Portrait]:
    """Return a portrait of every participant, in schedule order.

    It is a run of no steps in a temporary folder: every participant is started, loads its model,
    describes its outputs and is ended. interrupt: as of `run`. Names of an output that is `like`
    an input are those of the input; an infinite limit is one that does not exist.

    Raises DescribeFailed when that fails; the logs, which its sentence names, are then kept.
    """
    folder = Path(tempfile.mkdtemp(prefix="describe-stepbus-"))
    found: list[_Describe] = []

    def adapt(live: Strategy) -> Strategy:
        found.append(_Describe(live))
        return found[0]

    standing = dataclasses.replace(scenario, steps=0)
    result = run_with(adapt, standing, Options(out=folder / "run"), interrupt=interrupt)
    if result.exit_code not in {ExitCode.FINISHED, ExitCode.INTERRUPTED}:
        raise DescribeFailed(result.reason, result.exit_code)
    shutil.rmtree(folder, ignore_errors=True)
    if result.exit_code:
        raise DescribeFailed(result.reason, result.exit_code)
    return _portraits(scenario, found[0].outputs)


class _Describe:
    """The strategy of a description: a run whose participants are asked for nothing else."""

    def __init__(self, live: Strategy) -> None:
        self.outputs: Descriptions = {}
        self.peers = live.peers
        self._live = live

    def launch(self, state: RunState) -> None:
        """Start the participants, as for a run."""
        self._live.launch(state)

    def descriptions(self, participants: Participants) -> Descriptions:
        """Keep how the participants describe their outputs."""
        self.outputs = self._live.descriptions(participants)
        return self.outputs


def _portraits(scenario: Scenario, outputs: Descriptions) -> list[Portrait]:
    inputs = input_descriptions(scenario, outputs)
    return [
        Portrait(
            participant=name,
            inputs=_inputs(scenario, scenario.participant(name)),
            outputs=[
                _output(
                    port,
                    output.type,
                    _taken_by(scenario, name, port),
                    _with_names(outputs[name].get(port, Description()), inputs[name]),
                )
                for port, output in scenario.participant(name).outputs.items()
            ],
        )
        for name in Schedule.of(scenario).order
    ]


def _output(port: str, kind: str, taken_by: list[str], said: Description) -> OutputPort:
    joints = _joints(said) if kind == _JOINT_STATE else []
    return OutputPort(port=port, type=kind, taken_by=taken_by, description=said, joints=joints)


def _joints(said: Description) -> list[JointRow]:
    def limit(key: str, index: int) -> float | None:
        return said.limits[key][index] if key in said.limits else None

    def detail(key: str, index: int) -> str:
        return said.details[key][index] if key in said.details else ""

    return [
        JointRow(
            index=index,
            name=name,
            type=detail("type", index),
            mode=detail("mode", index),
            lower=limit("lower", index),
            upper=limit("upper", index),
            velocity=limit("velocity", index),
            effort=limit("effort", index),
            motor=_has_motor(detail("mode", index), limit("effort", index)),
        )
        for index, name in enumerate(said.names)
    ]


def _has_motor(mode: str, effort: float | None) -> bool | None:
    """Return whether a joint can be driven: by its mode, with a torque above zero."""
    if not mode and effort is None:
        return None
    return mode not in _WITHOUT_MOTOR and effort != 0.0


def _inputs(scenario: Scenario, spec: ParticipantSpec) -> list[InputPort]:
    return [
        InputPort(
            port=name,
            type=scenario.participant(item.source).outputs[item.port].type,
            source=f"{item.source}.{item.port}",
            delay=item.delay,
        )
        for name, item in spec.inputs.items()
    ]


def _taken_by(scenario: Scenario, participant: str, port: str) -> list[str]:
    return [
        f"{spec.name}.{name}"
        for spec in scenario.participants
        for name, item in spec.inputs.items()
        if (item.source, item.port) == (participant, port)
    ]


def _with_names(said: Description, heard: Mapping[str, Description]) -> Description:
    """Return a description with the names of the input it is `like`."""
    if said.like is None or said.like not in heard:
        return said
    return msgspec.structs.replace(said, names=heard[said.like].names)
