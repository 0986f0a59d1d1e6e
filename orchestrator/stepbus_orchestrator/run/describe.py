"""What the participants of a scenario say of themselves before any step."""

import dataclasses
import threading
from collections.abc import Mapping, Sequence

import msgspec

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.folder import scratch_folder
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_schemas import Description

_JOINT_STATE = "JointState/1"
_WITHOUT_MOTOR = ("passive", "teleport")


class InputPort(msgspec.Struct, frozen=True, kw_only=True):
    """One input. source: `participant.output`. delay: least age of its messages [steps]."""

    port: str
    type: str
    source: str
    delay: int


class JointRow(msgspec.Struct, frozen=True, kw_only=True):
    """One joint of a joint state.

    index: in every vector of the port. type, mode: as its participant describes them, or empty.
    lower, upper: stops [rad]; velocity [rad/s] and effort [N·m]: limits; None: not described;
    infinite: there is none. motor: whether anything can drive it; None where neither mode nor
    effort is described. Prismatic joints have [m] and [N].
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

    taken_by: inputs that read it, as `participant.input`. joints: of a joint state only.
    """

    port: str
    type: str
    taken_by: list[str]
    description: Description
    joints: list[JointRow] = []


class ParticipantDescription(msgspec.Struct, frozen=True, kw_only=True):
    """One participant: its ports, and the description of each output."""

    participant: str
    inputs: list[InputPort]
    outputs: list[OutputPort]


def describe(
    scenario: Scenario, interrupt: threading.Event | None = None
) -> list[ParticipantDescription]:
    """Return the ports of every participant, and their descriptions, in schedule order.

    It is a run of no steps in a temporary folder: every participant is started, loads its model,
    describes its outputs and is ended. interrupt: as of `run`. An output that is `like` an input
    has the names of that input.

    Raises RunFailure when that fails; it quotes the log of the culprit.
    """
    described = _Describe()
    without_steps = dataclasses.replace(scenario, steps=0)
    with scratch_folder("describe") as folder:
        options = Options(out=folder / "run", extensions=[described])
        run(without_steps, options, interrupt=interrupt).check()
    return _described(scenario, described.outputs)


class _Describe(RunExtension):
    """Keeps how the participants describe their outputs."""

    def __init__(self) -> None:
        self.outputs: Descriptions = {}

    def ready(self) -> None:
        """Take the descriptions."""
        self.outputs = self.run.descriptions


def _described(scenario: Scenario, outputs: Descriptions) -> list[ParticipantDescription]:
    inputs = input_descriptions(scenario, outputs)
    return [
        ParticipantDescription(
            participant=name,
            inputs=_inputs(scenario, scenario.participant(name)),
            outputs=[
                OutputPort(
                    port=port,
                    type=output.type,
                    taken_by=_taken_by(scenario, name, port),
                    description=description,
                    joints=_joints(output.type, description),
                )
                for port, output in scenario.participant(name).outputs.items()
                for description in [
                    _with_names(outputs[name].get(port, Description()), inputs[name])
                ]
            ],
        )
        for name in Schedule(scenario).order
    ]


def _joints(type_name: str, description: Description) -> list[JointRow]:
    if type_name != _JOINT_STATE:
        return []
    count = len(description.names)

    def limit(key: str) -> Sequence[float | None]:
        return description.limits.get(key, [None] * count)

    def detail(key: str) -> Sequence[str]:
        return description.details.get(key, [""] * count)

    return [
        JointRow(
            index=index,
            name=name,
            type=detail("type")[index],
            mode=detail("mode")[index],
            lower=limit("lower")[index],
            upper=limit("upper")[index],
            velocity=limit("velocity")[index],
            effort=limit("effort")[index],
            motor=_has_motor(detail("mode")[index], limit("effort")[index]),
        )
        for index, name in enumerate(description.names)
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


def _with_names(description: Description, inputs: Mapping[str, Description]) -> Description:
    """Return a description with the names of the input it is `like`."""
    if description.like is None or description.like not in inputs:
        return description
    return msgspec.structs.replace(description, names=inputs[description.like].names)
