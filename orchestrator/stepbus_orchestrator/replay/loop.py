"""Conducts a run in which all participants but one are played from a recording."""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from typing import Any

from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_orchestrator.recording import Descriptions, Sink, TimingRecorder
from stepbus_orchestrator.run.kernel.deadlines import check_start, took_nothing
from stepbus_orchestrator.run.kernel.participants import Phase
from stepbus_orchestrator.run.loop import Conductor
from stepbus_orchestrator.run.progress import Observer
from stepbus_orchestrator.scenario import Scenario, Schedule
from stepbus_participant import Bus
from stepbus_schemas import CallRecord, Decoder, MessageError, Outputs

from .peers import Peers

_decode_outputs = Decoder(Outputs)


class Replayer(Conductor):
    """A conductor that plays the peers too.

    participant: the one that is replayed. scenario: the recorded one, with as many steps as can
    be replayed. descriptions: of all outputs, as recorded. planned: its recorded calls.
    """

    def __init__(
        self,
        *,
        participant: str,
        scenario: Scenario,
        bus: Bus,
        token: str,
        recorder: Sink,
        timing: TimingRecorder,
        observer: Observer,
        interrupt: threading.Event,
        peers: Peers,
        descriptions: Descriptions,
        planned: Sequence[CallRecord] = (),
    ) -> None:
        super().__init__(
            scenario=scenario,
            bus=bus,
            token=token,
            recorder=recorder,
            timing=timing,
            observer=observer,
            interrupt=interrupt,
            planned=planned,
        )
        self._peers = peers
        self._recorded = descriptions
        self._newest: Any = None
        limit_s = scenario.participant(participant).deadlines.step_s
        self._watchdog = Watchdog(limit_s, self._kill)
        # Nobody waits for it, so that only its outputs themselves tell how far it came.
        bus.subscribe(f"out/{participant}", self._see)

    def _kill(self) -> None:
        """End the participant, which frees whoever sends to it."""
        for member in self.state.roster.values():
            member.child.signal(signal.SIGKILL)

    def close(self) -> None:
        """Watch no longer."""
        self._watchdog.close()

    def _see(self, sample: Any) -> None:
        self._newest = sample

    def newest_step(self) -> int:
        """Return the newest step the participant was seen to publish; −1 before the first."""
        try:
            return _decode_outputs(self._bus.payload(self._newest)).step if self._newest else -1
        except MessageError:
            return -1

    def _meet(self) -> None:
        """Exchange handshakes with the participant until it is ready."""
        while any(member.phase != Phase.READY for member in self.state.roster.values()):
            self._peers.send_handshake()
            self._turn(lambda elapsed_s: check_start(self.state.roster, elapsed_s))

    def _descriptions(self) -> Descriptions:
        """Return what everybody said of its outputs when it was recorded."""
        return self._recorded

    def _release(self) -> None:
        """Play the peers ahead of the participant, then let it follow."""
        barrier = self.state.barrier
        with self._watchdog.watching():
            self._peers.publish_below(barrier.step_limit, barrier.reported)
        if self._watchdog.fired:
            (member,) = self.state.roster.values()
            raise took_nothing(member, self.state.roster, barrier, self._scenario.step_ns)
        super()._release()

    def _close(self) -> None:
        """Let the peers close too."""
        end = self._last_step()
        closing = (name for name in self._peers.names if self._schedule.closing(name, end))
        self._peers.close(end, closing, self.state.barrier.reported)
        super()._close()

    @property
    def _schedule(self) -> Schedule:
        return Schedule.of(self._scenario)

    def _take_bulk(self, sample: Any) -> None:
        """Take bulk content of the participant; that of the peers is our own echo."""
        if self._bus.key(sample).split("/")[1] not in self._peers.names:
            super()._take_bulk(sample)
