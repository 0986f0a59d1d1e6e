"""One participant's part in a run, from its `Welcome` to its last log."""

import contextlib
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import nullcontext

from stepbus_participant.bus import Bus
from stepbus_participant.bus.ticket import (
    NO_CHECKPOINTS,
    CheckpointOrder,
    MessageFault,
    ProfileOrder,
)
from stepbus_participant.config import Config
from stepbus_participant.participant import InvalidInput, Participant
from stepbus_schemas import (
    SHIPPED,
    Fault,
    Ready,
    RunError,
    Types,
    Welcome,
    WiringError,
    encode,
    encoding_of,
    error_text,
    text_of,
    valid_unicode,
)

from .admission import await_delivery, await_start
from .checkpoints import Checkpoints
from .control import Answers, Control, OrchestratorLost, Stopped
from .inputs import PeerFault, make_inputs, make_sources
from .outbox import Outbox, OutputError
from .profile import Profiler
from .step_loop import StepLoop

_STOP_WAIT_S = 1.0
_AFTER_THE_RUN = 1 << 62


class Terminated(RunError):
    """A signal asked the process to end."""


class Session:
    """Runs one participant from its `Welcome` on.

    factory: makes the participant from its configuration. types: of its own classes. faults: what
    to do to its outputs on their way. profile: what to measure. checkpoint: when to save the state,
    and from which to start.
    """

    def __init__(
        self,
        factory: Callable[[Config], Participant],
        welcome: Welcome,
        bus: Bus,
        types: Types = SHIPPED,
        *,
        faults: Sequence[MessageFault] = (),
        profile: ProfileOrder | None = None,
        checkpoint: CheckpointOrder = NO_CHECKPOINTS,
    ) -> None:
        self._factory = factory
        self._welcome = welcome
        self._checkpoint = checkpoint
        self._bus = bus
        self._types = Types(welcome.types) | types
        self._inputs = make_inputs(welcome.inputs, self._types)
        self._sources = make_sources(self._inputs, welcome.token, bus.queue)
        self._subscribe()
        wake = [queue for s in self._sources for queue in (s.queue, *s.bulk_queues.values())]
        self._control = Control(bus, welcome.token, wake, welcome.name)
        self._profiler = Profiler(profile, welcome.name) if profile is not None else None
        make_outbox = Outbox if self._profiler is None else self._profiler.outbox
        self._outbox = make_outbox(welcome, bus, self._drops, self._types)
        if faults:
            self._outbox.inject(faults)
        self._put_fault = bus.publisher(f"fault/{welcome.name}", encoding_of("Fault/1"))
        self._step = -1

    def _subscribe(self) -> None:
        for source in self._sources:
            self._bus.subscribe_content(f"out/{source.name}", source.queue.put)
            for port, queue in source.bulk_queues.items():
                self._bus.subscribe(f"bulk/{source.name}/{port}", queue.put)

    def _drops(self) -> dict[str, int]:
        """Return cause → number of dropped messages."""
        total: dict[str, int] = {}
        if self._control.unauthenticated:
            total["unauthenticated"] = self._control.unauthenticated
        for source in self._sources:
            for cause, number in source.drops.items():
                total[cause] = total.get(cause, 0) + number
        return total

    def work(self) -> None:
        """Make the participant, run it, and close it on every path.

        Raises RunError when it cannot continue, once the orchestrator knows why.
        """
        participant: Participant | None = None
        try:
            participant = self._factory(Config.from_welcome(self._welcome, self._types))
            self._run(participant)
        except Stopped:
            pass
        except (OrchestratorLost, Terminated):
            raise
        except Exception as exc:
            self._report(exc)
            raise RunError(f"step {self._step}: {text_of(exc)}") from exc
        finally:
            if participant is not None:
                participant.close()

    def _run(self, participant: Participant) -> None:
        descriptions = await_start(
            self._bus, self._ready(participant), self._sources, self._outbox, self._control
        )
        self._outbox.hold_up_to(self._control.batches.get(self._welcome.name, 1))
        participant.start(descriptions)
        profiler = self._profiler
        loop = StepLoop(
            participant=participant if profiler is None else profiler.participant(participant),
            welcome=self._welcome,
            bus=self._bus,
            inputs=self._inputs,
            sources=self._sources,
            outbox=self._outbox,
            control=self._control,
            answers=Answers(participant.calls(), self._welcome, self._bus),
            checkpoints=Checkpoints(
                participant,
                self._welcome,
                self._bus,
                order=self._checkpoint,
                inputs=self._inputs,
                sources=self._sources,
            ),
        )
        try:
            with nullcontext() if profiler is None else profiler.writing(sys._getframe()):
                loop.run()
            if any(output.bulk for output in self._welcome.outputs.values()):
                await_delivery(self._bus, self._welcome)
        finally:
            self._step = loop.step.index

    def _ready(self, participant: Participant) -> Ready:
        """Return what the participant reports before the start.

        Raises OutputError when it is large, WiringError when nothing would ever be published.
        """
        has_output = type(participant).output is not Participant.output
        if self._welcome.publishes == "first" and self._welcome.outputs and not has_output:
            raise WiringError(
                f"{type(participant).__name__} has no method `output`, which publishes with "
                "`publishes: first`"
            )
        ready = Ready(
            name=self._welcome.name,
            token=self._welcome.token,
            outputs=dict(participant.describe()),
            versions=dict(participant.versions()),
            calls={name: method.description for name, method in participant.calls().items()},
        )
        size, limit = len(encode(ready)), self._welcome.max_outputs_bytes
        if size > limit:
            raise OutputError(
                f"descriptions of {size} bytes exceed the bus's limit of {limit}; "
                "set bus.low_latency: false"
            )
        return ready

    def _peer_fault(self, exc: InvalidInput) -> PeerFault:
        source = self._welcome.inputs[exc.port]
        where = f"{source.source}.{source.port} (input {exc.port})"
        return PeerFault(source.source, f"{where}: {exc.text}")

    def _report(self, exc: Exception) -> None:
        """Report the fault to the orchestrator, and wait for its stop (P10.1).

        Who is to blame is not waited for: a SIGTERM may come before the stop, even while this
        reports. What the process printed last has to be its own error.
        """
        with contextlib.suppress(Stopped, OrchestratorLost, Terminated):
            self._tell(exc)
            self._control.enter(_AFTER_THE_RUN)
            while self._control.wait(_STOP_WAIT_S):
                continue

    def _tell(self, exc: Exception) -> None:
        if isinstance(exc, InvalidInput) and exc.port in self._welcome.inputs:
            exc = self._peer_fault(exc)
        fault = Fault(
            name=self._welcome.name,
            token=self._welcome.token,
            step=self._step,
            type=_fault_type(exc),
            message=_sentence(exc)[:2000],
            traceback=valid_unicode(traceback.format_exc()[-20_000:]),
            blames=exc.blames if isinstance(exc, PeerFault) else None,
        )
        sys.stderr.write(fault.traceback)
        self._put_fault(encode(fault))


def _sentence(exc: Exception) -> str:
    return error_text(exc) if _fault_type(exc) == "raised" else text_of(exc)


def _fault_type(exc: Exception) -> str:
    if isinstance(exc, PeerFault | OutputError):
        return "message"
    return "wiring" if isinstance(exc, WiringError) else "raised"
