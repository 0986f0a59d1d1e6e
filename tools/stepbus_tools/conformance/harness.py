"""Plays the orchestrator and all peers to one participant, over the real bus."""

from collections.abc import Callable, Mapping

import msgspec

from stepbus_orchestrator.replay.recorded import outputs_of
from stepbus_participant import stamp
from stepbus_schemas import (
    HANDSHAKE_STEP,
    Batch,
    Description,
    Outputs,
    Start,
    Stop,
    Trigger,
    due_step,
    encode,
)
from stepbus_tools.conformance.feeds import Feed, Ports
from stepbus_tools.conformance.outcome import Failed
from stepbus_tools.conformance.session import Session

Hook = Callable[["Harness", int], None]
"""What is done at a step, beside what a plain run does."""


def _nothing(_harness: "Harness", _step: int) -> None: ...


class Harness(Session):
    """The run around one program: plays its orchestrator and all of its peers.

    Raises Failed as `Session` does, and when the program reads nothing.
    """

    _start: bytes | None = None
    _step_limit = 0

    # --- sending -----------------------------------------------------------------------------

    def _send(self, put: Callable[..., None], data: bytes, **options: bytes) -> None:
        with self._watchdog.watching():
            put(data, **options)
        if self._watchdog.fired:
            limit_s = self.spec.deadlines.step_s
            raise Failed(f"it read no messages for {limit_s:g} s while they queued up")

    def send_control(self, key: str, data: bytes) -> None:
        """Publish bytes on `start`, `trigger` or `stop`."""
        self._send(self._control[key], data)

    def send_handshake(self) -> None:
        """Send the handshake of every peer, also on its bulk ports."""
        for source, puts in self._bulk.items():
            self.publish_bytes(
                source, encode(Outputs(token=self.token, step=HANDSHAKE_STEP, t_ns=0))
            )
            for port in puts:
                self.publish_content(source, port, HANDSHAKE_STEP, b"")

    def start(self, descriptions: Mapping[str, Description] | None = None) -> None:
        """Send `Start`, with the descriptions of the participant's inputs."""
        own = dict(self.material.descriptions if descriptions is None else descriptions)
        slots = {} if self._slots is None else dict(self._slots.agree(self.transcript.readies[-1]))
        self._start = encode(Start(token=self.token, inputs={self.spec.name: own}, slots=slots))
        self.send_control("start", self._start)

    def release(self, step_limit: int) -> None:
        """Allow all steps below `step_limit`."""
        self._step_limit = max(self._step_limit, step_limit)
        self.send_control("trigger", encode(Trigger(token=self.token, step_limit=step_limit)))

    def repeat(self) -> None:
        """Send the newest start and trigger again, in case they were lost."""
        if self._start is not None and not self.transcript.outputs:
            self.send_control("start", self._start)
        if self._step_limit:
            self.release(self._step_limit)

    def stop(self, at_step: int) -> None:
        """Send `Stop`."""
        stop = Stop(token=self.token, reason="the check ends", at_step=at_step)
        self.send_control("stop", encode(stop))

    def publish(self, source: str, step: int, ports: Ports, late: int = 0) -> None:
        """Publish the outputs of a source at a step; late: as of `SharedSlots.write`."""
        outputs, content = self.outputs(source, step, ports, late=late)
        for port, data in content.items():
            self.publish_content(source, port, step, data)
        self.publish_bytes(source, outputs)

    def publish_batch(self, source: str, rows: Mapping[int, Ports]) -> None:
        """Publish the outputs of a source at several steps at once; none has bulk content."""
        entries = [msgspec.Raw(self.outputs(source, step, row)[0]) for step, row in rows.items()]
        self.publish_bytes(source, encode(Batch(token=self.token, outputs=entries)))

    def outputs(
        self, source: str, step: int, ports: Ports, token: str | None = None, late: int = 0
    ) -> tuple[bytes, dict[str, bytes]]:
        """Return the `Outputs` of a source at a step, and the content of its bulk ports.

        That in slots is written. token: another one than that of the run. late: as of
        `SharedSlots.write`.
        """
        outputs, content = outputs_of(
            step,
            ports,
            self._bulk.get(source, {}),
            token=token or self.token,
            step_ns=self.scenario.step_ns,
        )
        if self._slots is not None:
            outputs, content = self._slots.write(source, outputs, content, late)
        return encode(outputs), content

    def publish_content(
        self, source: str, port: str, step: int, data: bytes, token: str | None = None
    ) -> None:
        """Publish the content of a bulk port; token: another one than that of the run."""
        self._send(self._bulk[source][port], data, attachment=stamp(step, token or self.token))

    def publish_bytes(self, source: str, data: bytes) -> None:
        """Publish bytes on behalf of a source."""
        self._send(self._peers[source], data)

    def feed(self, feed: Feed, step: int) -> None:
        """Publish the outputs of all sources at a step."""
        for source, rows in feed.items():
            if step in rows and step % self.scenario.participant(source).every == 0:
                self.publish(source, step, rows[step])

    # --- stepping ----------------------------------------------------------------------------

    def await_join(self) -> None:
        """Wait until it has asked to join."""
        limits = self.spec.deadlines
        self.until(
            lambda: self.transcript.asked, "a request to join", limits.spawn_s + limits.join_s
        )

    def await_ready(self) -> None:
        """Exchange handshakes with it until it is ready."""
        self.send_handshake()
        limit_s = self.spec.deadlines.ready_s
        self.until(lambda: self.transcript.readies, "Ready", limit_s, self.send_handshake)

    def await_output(self, step: int, *, repeating: bool = True) -> None:
        """Wait until it has published the newest step it fires at, up to `step`.

        repeating: whether the trigger is repeated meanwhile.
        """
        due = due_step(step, every=self.spec.every)
        has_bulk = any(output.bulk for output in self.spec.outputs.values())
        self.until(
            lambda: self.transcript.newest >= due and not self.transcript.awaited,
            f"step {due}, with all that it announces," if has_bulk else f"step {due}",
            self.spec.deadlines.step_s,
            self.repeat if repeating else None,
        )

    def await_logged(self, count: int | None = None) -> None:
        """Wait until `count` outputs have been logged; default: all it has published."""
        transcript, every = self.transcript, self.spec.every
        wanted = len(transcript.packed) if count is None else count
        step = transcript.newest if count is None else (count - 1) * every
        self.until(
            lambda: len(transcript.logged) >= wanted,
            f"the log of step {step}",
            self.spec.deadlines.step_s,
            self.repeat,
        )

    def walk(
        self,
        feed: Feed,
        first: int,
        end: int,
        *,
        before: Hook = _nothing,
        after: Hook = _nothing,
    ) -> None:
        """Do the steps from `first` to below `end` in lockstep.

        before, after: are done before and behind the inputs of a step.
        """
        for step in range(first, end):
            self.release(step + 1)
            before(self, step)
            self.feed(feed, step)
            after(self, step)
            self.await_output(step)

    def follow(self, feed: Feed) -> None:
        """Do all steps as a run does: as far ahead of what is logged as the window allows."""
        fed, steps, logged = 0, self.material.steps, self.transcript.logged
        while (done := len(logged) * self.spec.every) < steps:
            step_limit = min(steps, done + self.scenario.window)
            for step in range(fed, step_limit):
                self.feed(feed, step)
            fed = max(fed, step_limit)
            self.release(step_limit)
            self.await_logged(len(logged) + 1)
