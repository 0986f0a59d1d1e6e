"""Runs of the store, and what their recordings show."""

import numpy as np
from support.runs.patience import patient

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.fault_texts import PROCESS_FAULTS, faults_of
from stepbus_orchestrator.scenario.load import load

NAMES = ("plant", "perception", "world", "mission", "controller", "planner")


def store(folder, *overrides, scenario="store/truth", in_process=True):
    """Run the store; in one process it takes half the time, and records the same bytes."""
    loaded = load(scenario, patient(scenario, *overrides))
    # Only a process can be killed.
    in_process = in_process and not faults_of(loaded.faults, PROCESS_FAULTS)
    return run(loaded, Options(out=folder / "out", host=host_of(in_process=in_process)))


def last(recording, topic):
    """Return the last message of a port."""
    return list(recording.messages(topic))[-1][1]


def texts(recording, topic):
    return [
        message.text for _, message in recording.messages(topic) if getattr(message, "text", "")
    ]


def moves(recording):
    """Return how far each item has moved from beginning to end [m]."""
    described = recording.ports["plant/poses"].description
    poses = [message for _, message in recording.messages("plant/poses")]
    before, after = np.array(poses[0].position), np.array(poses[-1].position)
    ways = np.linalg.norm(after - before, axis=1)
    rows = zip(described.names, described.details["type"], ways, strict=True)
    return {name: way for name, kind, way in rows if kind}
