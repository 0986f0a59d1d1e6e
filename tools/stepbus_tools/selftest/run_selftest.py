"""Sends every joint of a plant to a known angle in turn, and judges what comes of it."""

import dataclasses
import threading
from collections.abc import Mapping, Sequence

import msgspec
from msgspec import structs

from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.run.describe import describe
from stepbus_orchestrator.run.folder import scratch_folder
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.ports import InputSpec, OutputSpec
from stepbus_schemas import Description, WiringError
from stepbus_tools.selftest.judge import Verdict, best, judge
from stepbus_tools.selftest.tester import by_mode, make_plan, read_joints
from stepbus_tools.signals import read_signal

_COMMAND, _STATE, _EVENT = "JointCommand/1", "JointState/1", "Event/1"
_TESTER = "selftest"
_QUANTITIES = ("position", "velocity", "effort")


class SelfTest(msgspec.Struct, frozen=True, kw_only=True):
    """What a self-test found. plant: the participant tested. simulated_s: how long it took [s]."""

    plant: str
    simulated_s: float
    joints: list[Verdict]

    @property
    def ok(self) -> bool:
        """Return whether nothing is wrong with any joint."""
        return all(verdict.ok for verdict in self.joints)


def selftest(
    scenario: Scenario,
    angle: float,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> SelfTest:
    """Run the plant of a scenario alone with a tester, and judge each of its joints.

    angle: to send rotary joints to [rad], or as near as their stops allow. A joint that gets
    there on neither side is sent half as far: the robot may have been in its own path.
    Raises WiringError where the scenario has no plant that is commanded by joint, RunFailure
    when its run fails; it quotes the log of the culprit.
    """
    plant, port = _plant_of(scenario)
    description = _described(scenario, plant.name, port, interrupt)

    def attempt(angle: float, only: list[str]) -> SelfTest:
        aim = {"angle": angle, "only": only}
        tested = _test_scenario(scenario, plant, port, description, aim)
        with scratch_folder("selftest") as folder:
            result = run(tested, Options(out=folder / "run"), observer, interrupt).check()
            return _judged(result, plant, port, angle, only)

    outcome = attempt(angle, list(description.names))
    missed = [verdict.joint for verdict in outcome.joints if not verdict.ok]
    if not missed:
        return outcome
    again = attempt(angle / 2, missed)
    pairs = zip(outcome.joints, again.joints, strict=True)
    better = {v.joint: best([first, v]) for first, v in pairs if v.ok and v.joint in missed}
    return SelfTest(
        plant=plant.name,
        simulated_s=outcome.simulated_s + again.simulated_s,
        joints=[better.get(verdict.joint) or verdict for verdict in outcome.joints],
    )


def _plant_of(scenario: Scenario) -> tuple[ParticipantSpec, str]:
    """Return what reads joint commands and publishes joint states, and on which port."""
    for spec in scenario.participants:
        states = [name for name, output in spec.outputs.items() if output.type == _STATE]
        if states and _command_inputs(scenario, spec):
            return spec, states[0]
    raise WiringError(
        f"{scenario.name}: no participant reads a {_COMMAND} and publishes a {_STATE}; there is "
        "nothing to test"
    )


def _command_inputs(scenario: Scenario, spec: ParticipantSpec) -> list[str]:
    return [
        name
        for name, item in spec.inputs.items()
        if scenario.participant(item.source).outputs[item.port].type == _COMMAND
    ]


def _described(
    scenario: Scenario, plant: str, port: str, interrupt: threading.Event | None
) -> Description:
    participant = next(p for p in describe(scenario, interrupt) if p.participant == plant)
    description = next(output.description for output in participant.outputs if output.port == port)
    if not by_mode(read_joints(description)):
        raise WiringError(f"{plant}.{port} has no joint with a motor; nothing to test")
    return description


def _test_scenario(
    scenario: Scenario,
    plant: ParticipantSpec,
    port: str,
    description: Description,
    aim: Mapping[str, object],
) -> Scenario:
    """Return a scenario of the plant and a tester, which has an output for each mode."""
    modes = {
        mode: [joint.name for joint in group]
        for mode, group in by_mode(read_joints(description)).items()
    }
    spare = [f"command_{mode}" for mode in modes]
    ports = dict(zip(modes, [*_command_inputs(scenario, plant), *spare], strict=False))
    kept = {name: out for name, out in plant.outputs.items() if out.type in (_STATE, _EVENT)}
    tester = ParticipantSpec(
        name=_TESTER if plant.name != _TESTER else f"{_TESTER}_2",
        participant="stepbus_tools.selftest.tester:Tester",
        every=plant.every,
        inputs={"joint_state": InputSpec(from_=f"{plant.name}.{port}")},
        outputs={mode: OutputSpec(type=_COMMAND) for mode in modes},
        params={**aim, "names": modes},
    )
    alone = structs.replace(
        plant,
        inputs={name: InputSpec(from_=f"{tester.name}.{mode}") for mode, name in ports.items()},
        outputs=kept,
        on_fault="stop",
    )
    return dataclasses.replace(
        scenario,
        name=f"{scenario.name}_selftest",
        steps=None,
        participants=(alone, tester),
        faults=(),
    )


def _judged(
    result: Result, plant: ParticipantSpec, port: str, angle: float, only: Sequence[str]
) -> SelfTest:
    recording = Recording(result.recording)
    topic: Port = recording[f"{plant.name}.{port}"]
    state = read_signal(topic, topic, _QUANTITIES)
    if state is None or "position" not in state.fields:
        raise WiringError(f"{plant.name}.{port} has no positions; nothing to test")
    joints = read_joints(topic.description, state.fields["position"][0].tolist())
    plan = make_plan(joints, plant.every * result.step_ns * 1e-9, angle, only)
    verdicts = judge(joints, plan, state)
    return SelfTest(plant=plant.name, simulated_s=result.simulated_s, joints=verdicts)
