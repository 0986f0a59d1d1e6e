"""One participant under the conformance kit, without recording its inputs anew for each test."""

import dataclasses
import sys
import threading

from support.paths import PROGRAMS

from stepbus_orchestrator.scenario.load import load
from stepbus_tools.conformance import CHECKS, select
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.material import read
from stepbus_tools.conformance.play import run_checks

STOPS = [
    "replayed-log", "stop-before-ready", "stop-before-start", "stop-while-waiting",
    "stop-between-steps", "stop-at-end", "stop-overtakes",
]  # fmt: skip
# Mistake of wrong_controller.py → the checks that find it; all others pass or are skipped.
FOUND_BY = {
    "AnyStop": ["control-noise"],
    "AnyToken": ["unauthenticated"],
    "AnyWelcome": ["wrong-replies", "welcome-protocol", "welcome-name", "welcome-token"],
    "AsksForever": ["nobody-answers"],
    "AsksOne": ["wrong-replies"],
    "BigBatches": ["batch"],
    "Clock": ["determinism"],
    "Consolidates": ["wrong-replies"],
    "ExitsThree": STOPS,
    "ExitsZeroWithoutTicket": ["no-ticket"],
    "FiresAlways": ["own-every"],
    "FirstReply": ["wrong-replies"],
    "FixedOrder": ["joint-order"],
    "ForgetsInputs": ["rarer-source", "held"],
    "ForgivesDuplicates": ["changed-duplicate"],
    "FreezesAtLarge": ["oversize"],
    "HandshakesOnce": ["handshake"],
    "HangsAtGarbage": ["garbage"],
    "IgnoresDelay": ["delayed", "nothing-due"],
    "IgnoresStop": STOPS,
    "IgnoresTerm": ["sigterm"],
    "IgnoresTriggers": ["waits-for-trigger"],
    "KnownPorts": ["unread-ports", "oversize"],
    "LastTrigger": ["triggers"],
    "LaterStart": ["start-again"],
    "LosesBatches": ["batches"],
    "Mistyped": ["content", "replayed-log"],
    "NoText": ["codecs"],
    "NoDuplicates": ["duplicate", "stale"],
    "NoHandshakes": ["peers-last"],
    "NoLog": [
        "log", "batch", "windows", "replayed-log", "changed-duplicate", "skipped-step",
        "malformed-outputs", "wrong-message", "stop-at-end", "stop-overtakes",
    ],
    "OnlyFloats": ["numbers"],
    "Random": ["determinism"],
    "RoundsToZero": ["nothing-due"],
    "Silent": ["waits-for-trigger", "late-input"],
    "SilentFaults": [
        "absent", "delayed", "nothing-due", "changed-duplicate", "skipped-step", "malformed-outputs",
        "wrong-message",
    ],
    "StepsMissing": ["steps", "replayed-log"],
    "StopsAtOnce": ["stop-overtakes"],
    "StrangerOutputs": ["steps"],
    "StrictFields": ["unknown-fields"],
    "TakesNewest": ["windows", "inputs-ahead"],
    "TicketNumber": ["later-protocols"],
    "TwiceDifferent": ["steps"],
    "Unwatchful": ["orchestrator-gone"],
    "WrongEncoding": ["encodings"],
    "WrongLimits": ["descriptions", "replayed-log"],
    "WrongPorts": ["port-types", "replayed-log"],
    "WrongTime": ["steps", "replayed-log"],
    "WrongToken": ["join", "replayed-log"],
    "ZerosForHeld": ["held"],
}  # fmt: skip

# Mistake → a check that it fails as well where a link is slow: it steps before the link is there.
MAY_FAIL = {"NoHandshakes": ["peers-first"], "TakesNewest": ["peers-first"]}


def material(recording, participant="controller", *overrides):
    """Return the first 24 steps of a recording of two_link as inputs."""
    scenario = dataclasses.replace(load("two_link", overrides), steps=24)
    return read(scenario, participant, recording)


def outcomes(inputs, words, logs, names=(), interrupt=None):
    """Return name → result of checks of a program; words: its command line."""
    interrupt = interrupt or threading.Event()
    logs.mkdir(exist_ok=True)
    checks = select(names) if names else CHECKS
    kit = Kit(
        material=inputs,
        command=words,
        cwd=logs,
        logs=logs,
        interrupt=interrupt,
        is_plain_checked=not names or "steps" in names,
    )
    return {result.name: result for result in run_checks(kit, checks, lambda _result: None)}


def failed(results):
    """Return the names of the checks that failed."""
    return [name for name, result in results.items() if result.outcome == "fail"]


def program(name, *arguments):
    """Return the command line of a program of the tests."""
    return (sys.executable, str(PROGRAMS / name), *arguments)


def ours(participant):
    """Return the command line of a participant of two_link that ships."""
    name = f"stepbus_{participant}:{participant.capitalize()}"
    return (sys.executable, "-P", "-m", "stepbus_participant", name)
