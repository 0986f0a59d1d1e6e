"""Scenarios, processes and a bus in memory, to test the run loop without starting anything."""

import time
from contextlib import nullcontext
from pathlib import Path
from queue import SimpleQueue

import msgspec

from stepbus_orchestrator.processes.activity import Activity
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.recording import Sink
from stepbus_orchestrator.run.extension import Strategy
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.ports import InputSpec, OutputSpec
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import Sample, every_on_a_thread
from stepbus_schemas import Decoder, JointState, Log, Outputs, Ready, Stop, Trigger, encode

TOKEN = "00c0ffee00c0ffee"
STEP_NS = 5_000_000


def participant(name, *sources, every=1, publishes="last", delay=0, **options):
    """Return a participant with one output `state`, and one input for each source."""
    inputs = {source: InputSpec(from_=f"{source}.state", delay=delay) for source in sources}
    return ParticipantSpec(
        name=name, exec=("program",), every=every, publishes=publishes, inputs=inputs,
        outputs={"state": OutputSpec(type="JointState/1")}, **options,
    )  # fmt: skip


PLANT = participant("plant", "controller", publishes="first")
MISSION = participant("mission", every=4)
CONTROLLER = participant("controller", "plant", "mission")


def scenario(*participants, steps=8, window=64, **options):
    """Return a scenario; default: plant, mission (every 4), controller, as in two_link."""
    return Scenario(
        name="test", step_ns=STEP_NS, steps=steps, seed=0, window=window,
        participants=participants or (PLANT, MISSION, CONTROLLER),
        folder=Path("/"), file=Path("/scenario.yaml"), **options,
    )  # fmt: skip


class FakeProcess(Process):
    """A process that never ran: it ends when it is told to."""

    def __init__(self):
        super().__init__(Path("one.log"))
        self.pid = 7
        self.code = None
        self.stopped = False
        self.signals = []

    def exit_code(self):
        return self.code

    def how_it_ended(self):
        return f"exited with code {self.code}"

    def activity(self):
        return Activity(is_stopped=self.stopped)

    def signal(self, number):
        self.signals.append(number)
        if number == 9:
            self.code = -9

    def wait(self, timeout_s):
        return self.code is not None

    def end(self, grace_s=0.0):
        self.code = 0 if self.code is None else self.code


def states(scenario):
    """Return the states of all participants of a scenario, ready and with processes that run."""
    members = {spec.name: ParticipantState(spec, FakeProcess()) for spec in scenario.participants}
    for member in members.values():
        member.phase = member.phase.READY
    return members


def outputs(step, name="plant"):
    """Return what a participant publishes at a step."""
    state = msgspec.Raw(encode(JointState(position=[float(step)])))
    return Outputs(token=TOKEN, step=step, t_ns=step * STEP_NS, ports={"state": state})


def log(name, *steps, **fields):
    """Return a participant's log of the outputs of some steps."""
    entries = [msgspec.Raw(encode(outputs(step))) for step in steps]
    return encode(Log(name=name, token=TOKEN, outputs=entries, **fields))


class Timing:
    """Keeps the names of events."""

    def __init__(self):
        self.events = []

    def event(self, event, participant="", text=""):
        self.events.append(event)

    def steps(self, participant, rows):
        pass

    def trigger(self, step_limit):
        pass


class Transcript(Sink):
    """A sink that keeps what would be recorded, as text: `plant@0 mission@0 controller@0`."""

    def __init__(self, scenario):
        super().__init__({name: ["state"] for name in Schedule(scenario).order})
        self._written = []
        self.ends = []

    @property
    def text(self):
        return " ".join(self._written)

    def add_metadata(self, name, content, before=0):
        self.ends.append(name)

    def write_step(self, step, closing=None):
        revised = self.revised(step, closing)
        self._written += [f"{item.participant}@{item.step}" for item in revised]

    def finish(self, closing_step, closing):
        super().finish(closing_step, closing)
        self.ends.append("finish")


class Bus:
    """A bus in memory with scripted participants, which log all that a trigger permits.

    order: in which their logs arrive. dies: (participant, step): its process ends there.
    lost_stops: how many are lost. deaf: a put of a stop blocks until this one is killed.
    """

    lost_stops, deaf = 0, ""

    clock, exchange = time, None
    queue = SimpleQueue
    every = staticmethod(every_on_a_thread)

    def __init__(self, scenario, order, dies=None):
        self.processes = {spec.name: FakeProcess() for spec in scenario.participants}
        self.triggers = []
        self.stops = []
        self._specs = {spec.name: spec for spec in scenario.participants}
        self._order = order
        self._dies = dies
        self._next = dict.fromkeys(self._specs, 0)
        self._sinks = {}

    def publisher(self, key, encoding, *, remote=False):
        react = {"trigger": self._on_trigger, "stop": self._on_stop}.get(key, lambda data: None)
        return lambda data, attachment=b"": react(data)

    def subscribe(self, key, sink):
        self._sinks[key] = sink

    answer = watch_alive = subscribe_content = subscribe

    def declare_alive(self, key):
        pass

    def launched(self):
        for name in self._order:
            ready = Ready(name=name, token=TOKEN)
            self._sinks["ready/*"](Sample(f"ready/{name}", encode(ready), b"", ""))

    def _on_trigger(self, data):
        limit = Decoder(Trigger)(data).step_limit
        if not self.triggers or self.triggers[-1] != limit:
            self.triggers.append(limit)
        for name in self._order:
            self._work_below(name, limit)

    def _work_below(self, name, limit):
        steps = []
        while self._next[name] < limit and self.processes[name].code is None:
            if (name, self._next[name]) == self._dies:
                self._leave(name, 3)
                break
            steps.append(self._next[name])
            self._next[name] += self._specs[name].every
        if steps:
            self._log(name, *steps)

    def _log(self, name, *steps):
        self._sinks[f"log/{name}"](log(name, *steps))

    def _on_stop(self, data):
        while self.deaf and self.processes[self.deaf].code is None:
            time.sleep(0.01)
        self.lost_stops -= 1
        if self.lost_stops >= 0:
            return
        stop = Decoder(Stop)(data)
        self.stops.append(stop.at_step)
        for name, spec in self._specs.items():
            if self.processes[name].code is None:
                if spec.publishes == "first" and self._next[name] == stop.at_step:
                    self._log(name, stop.at_step)
                self._leave(name, 0)

    def _leave(self, name, code):
        self.processes[name].code = code
        self._sinks["alive/*"](f"alive/{name}", False)


class Launched(Strategy):
    """A strategy that starts the processes of a bus in memory."""

    def __init__(self, bus):
        self._bus = bus

    def launch(self, run):
        for spec in run.state.scenario.participants:
            run.started(ParticipantState(spec, self._bus.processes[spec.name]))
        self._bus.launched()


class RunInMemory:
    """A whole run, without a process: what would be recorded, and the phases it went through."""

    def __init__(self, scenario, *, order=None, dies=None, **controls):
        order = order or [spec.name for spec in scenario.participants]
        self.bus = Bus(scenario, order, dies)
        self.sink = Transcript(scenario)
        self.timing = Timing()
        self.loop = Run(scenario, self.sink, self.timing, out=Path("no folder"), **controls)
        self.loop.token = TOKEN
        self.phases = [self.loop.state.phase.value]
        enter = self.loop.state.enter

        def noted(phase):
            enter(phase)
            self.phases.append(phase.value)

        self.loop.state.enter = noted

    def run(self):
        return self.loop.take_place(self)

    def open(self, run):
        return nullcontext((self.bus, Launched(self.bus)))
