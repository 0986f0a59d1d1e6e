"""Ten thousand mutated messages on every key that is listened to: none is accepted, none hurts."""

from __future__ import annotations

import time
from types import SimpleNamespace

import msgspec
import pytest
from support.messages.fuzz import (
    OLD_TOKEN,
    STEP_NS,
    TOKEN,
    HandBus,
    Mutator,
    Sample,
    envelopes,
    outputs,
)
from support.runs.joints import write_scenario

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import McapFile, Recorder, TimingRecorder
from stepbus_orchestrator.run.extension import Strategy
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.kernel.participants import ParticipantState, Phase
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Endpoint, Ticket
from stepbus_participant.inputs import Input, PeerFault, make_sources
from stepbus_participant.session.admission import join
from stepbus_participant.session.control import Control, OrchestratorLost, watched_orders
from stepbus_schemas import InputConfig, MessageError, Refusal, RunError, Welcome, encode

TO_ORCHESTRATOR = ["join", "ready/controller", "log/controller", "fault/controller"]
TO_PARTICIPANTS = ["start", "trigger", "stop"]
PER_KEY = 1000


class Child:
    """A process that runs on, whatever happens."""

    pid, log, late = 7, "controller.log", None

    def where(self):
        return "pid 7"

    def silence(self):
        return ""

    def exit_code(self):
        return None

    def wait(self, timeout_s):
        return False


class Stand:
    """A run loop that gets its messages by hand; `state` is all that they might change."""

    def __init__(self, folder, *overrides):
        scenario = load(write_scenario(folder / "source"), overrides)
        specs = scenario.participants
        self.bus = HandBus()
        self.recorder = Recorder(McapFile(folder / "run.mcap"), list(specs), scenario.step_ns)
        self.timing = TimingRecorder(folder / "timing.mcap", time)
        self.loop = Run(scenario, self.recorder, self.timing, out=folder, extensions=[Calls()])
        self.loop.token = TOKEN
        self.loop.attach(self.bus, Strategy())
        self.session = self.loop.session
        self.loop.state.participants = {
            spec.name: ParticipantState(spec, Child()) for spec in specs
        }

    def take(self, sample):
        self.bus.hand(sample)
        self.receive()

    def receive(self):
        self.session.inbox.receive(0)

    def start(self):
        """Let the clock of the run begin."""
        self.recorder.open_channels({}, {})
        self.loop.state.started_at = 1.0

    def state(self):
        members = self.loop.state.participants.values()
        phases = [(m.phase, m.ready, m.waiting, dict(m.drops), m.language) for m in members]
        return phases, dict(self.loop.state.barrier.reported), self.loop.state.end

    def close(self):
        self.session.close()
        self.recorder.abort()
        self.timing.close()


@pytest.fixture
def stand(tmp_path):
    made = Stand(tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize("key", TO_ORCHESTRATOR)
def test_the_orchestrator_counts_every_mutant_and_takes_none(stand, key):
    mutator, before = Mutator(1), stand.state()
    for _ in range(PER_KEY):
        stand.take(Sample(key, mutator.broken(envelopes()[key])))
    assert (stand.loop.state.unauthenticated, stand.state()) == (PER_KEY, before)


@pytest.mark.parametrize("key", TO_ORCHESTRATOR)
def test_the_orchestrator_takes_the_message_that_was_not_mutated(stand, key):
    before, failure = stand.state(), None
    stand.start()
    try:
        stand.take(Sample(key, encode(envelopes()[key])))
    except RunFailure as exc:
        failure = exc
    assert failure is not None or stand.state() != before
    assert stand.loop.state.unauthenticated == 0


@pytest.mark.parametrize("key", TO_ORCHESTRATOR)
def test_a_mutant_that_still_has_the_token_ends_in_at_most_one_sentence(tmp_path, key):
    mutator, stand, sentences = Mutator(2), Stand(tmp_path), []
    stand.start()
    for member in stand.loop.state.participants.values():
        member.phase = Phase.READY
    for _ in range(PER_KEY):
        try:
            stand.take(Sample(key, mutator.mutant(encode(envelopes()[key]))))
        except RunFailure as failure:
            sentences.append(str(failure))
    stand.close()
    assert all(sentences)


def test_bulk_content_with_a_mutated_stamp_is_counted_and_not_taken(tmp_path):
    stand, mutator = Stand(tmp_path, "controller.outputs.image={type: JointState/1, bulk: true}"), Mutator(4)  # fmt: skip
    for _ in range(PER_KEY):
        stand.take(Sample("bulk/controller/image", b"pixels", mutator.broken_stamp()))
    stand.close()
    assert stand.loop.state.unauthenticated == PER_KEY


@pytest.mark.parametrize("name", ["stranger", "Plant"])
def test_somebody_alive_who_is_not_in_the_run_is_counted(stand, name):
    before = stand.state()
    stand.bus.sinks["alive/*"](f"alive/{name}", True)
    stand.receive()
    assert (stand.loop.state.unauthenticated, stand.state()) == (1, before)


WELCOME = Welcome(
    protocol=2, name="controller", token=TOKEN, step_ns=STEP_NS, every=1, publishes="last", window=1,
    batch=1, seed=0, inputs={}, outputs={}, params={}, folder="/",
)  # fmt: skip
TICKET = Ticket(run="r", name="controller", token=TOKEN, endpoint=Endpoint(listen=[], connect=[]))


@pytest.mark.parametrize("key", TO_PARTICIPANTS)
def test_a_participant_counts_every_mutant_of_the_orchestrators_word(key):
    bus, mutator = HandBus(), Mutator(5)
    control = Control(bus, WELCOME, watched_orders(bus), [], drops := {})
    for _ in range(PER_KEY):
        bus.hand(Sample(key, mutator.broken(envelopes()[key])))
    control.enter(0)
    control.poll()
    assert (drops, control.step_limit, control.started) == ({"unauthenticated": PER_KEY}, 0, None)


def test_a_participant_hears_of_an_orchestrator_that_died_before_the_welcome_was_read():
    bus = HandBus()
    orders = watched_orders(bus)
    bus.sinks["alive/orchestrator"]("alive/orchestrator", False)
    control = Control(bus, WELCOME, orders, [], {})
    with pytest.raises(OrchestratorLost):
        control.wait(10.0)


def source():
    config = InputConfig(source="controller", port="command", type="JointCommand/1")
    return make_sources({"command": Input("command", config)}, TOKEN)[0]


def test_a_consumer_drops_or_blames_every_mutant_and_takes_none():
    listener, mutator, blamed = source(), Mutator(6), 0
    for _ in range(2 * PER_KEY):
        try:
            assert listener.accept(mutator.broken(outputs())) is None
        except PeerFault as fault:
            blamed += fault.blames == "controller"
    assert (listener.step, listener.connected) == (-1, False)
    assert sum(listener.drops.values()) + blamed == 2 * PER_KEY
    assert listener.drops.keys() == {"malformed", "unauthenticated"}


def test_a_mutated_port_message_is_blamed_on_its_sender():
    mutator, port, blamed = Mutator(7), bytes(outputs().ports["command"]), set()
    config = InputConfig(source="controller", port="command", type="JointCommand/1")
    for step in range(PER_KEY):
        item = Input("command", config)
        item.pending.append((step, mutator.mutant(port)))
        try:
            item.settle(step)
        except PeerFault as fault:
            blamed.add(fault.blames)
    assert blamed == {"controller"}


def test_a_mutated_answer_to_a_hello_is_refused_in_a_sentence():
    mutator = Mutator(9)
    welcome = msgspec.structs.replace(WELCOME, params={"gains": [1, {"a": None}]})
    for _ in range(PER_KEY):
        answer = mutator.broken(welcome)
        with pytest.raises(
            (RunError, MessageError), match=r"answer to Hello|the orchestrator speaks"
        ):
            join(SimpleNamespace(clock=time, query=lambda *_, reply=answer: [reply]), TICKET)


def test_whoever_else_answers_a_hello_keeps_nobody_out():
    unauthenticated = msgspec.structs.replace(WELCOME, token=OLD_TOKEN)
    answers = [encode(Refusal(reason="go away")), b"\xc1", encode(unauthenticated), encode(WELCOME)]
    assert join(SimpleNamespace(clock=time, query=lambda *_: answers), TICKET) == WELCOME
    with pytest.raises(RunError, match="go away"):
        join(SimpleNamespace(clock=time, query=lambda *_: answers[:3]), TICKET)
