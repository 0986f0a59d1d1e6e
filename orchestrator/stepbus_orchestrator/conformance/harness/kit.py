"""What checks share: a harness for each start, and a plain run to compare with."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.analysis.comparison import PortComparison, Tolerance
from stepbus_orchestrator.conformance.outcome import Failed, Skipped
from stepbus_schemas import Description

from .feeds import Feed
from .harness import Harness
from .material import Material
from .setup import Setup
from .transcript import Transcript

Play = Callable[[Harness], None]


@dataclass(frozen=True, kw_only=True)
class Trace:
    """The result of one run: step → port → bytes, and the transcript."""

    ports: Mapping[int, Mapping[str, bytes]]
    transcript: Transcript

    @classmethod
    def of(cls, transcript: Transcript) -> Trace:
        """Return the trace of a finished run."""
        return cls(ports=transcript.ports(), transcript=transcript)


class Kit:
    """One participant under test.

    material: what the kit plays to it. command: its command line. cwd: where it is started. logs:
    gets a folder for each start of it. interrupt: ends everything when it is set. is_scenarios:
    whether it is the scenario's own program. knows_names: whether it learns the names of its
    inputs; not through the raw bridge.
    """

    def __init__(
        self,
        *,
        material: Material,
        command: Sequence[str],
        cwd: Path,
        logs: Path,
        interrupt: threading.Event,
        is_scenarios: bool = False,
        knows_names: bool = True,
    ) -> None:
        self.material = material
        self.is_scenarios = is_scenarios
        self.knows_names = knows_names
        self.spec = material.spec
        self.command, self.cwd = tuple(command), cwd
        self.interrupt = interrupt
        self.check = ""
        self._logs = logs
        self._count = 0
        self._traces: dict[str, Trace | Failed] = {}

    @property
    def steps(self) -> int:
        """Return for how many steps there is material."""
        return self.material.steps

    @property
    def middle(self) -> int:
        """Return a step in the middle at which the participant and all its sources fire."""
        sources = [self.material.scenario.participant(name) for name in self.material.feed]
        common = [
            s for s in range(self.steps) if all(s % p.every == 0 for p in (self.spec, *sources))
        ]
        return common[len(common) // 2]

    def harness(self, setup: Setup | None = None) -> Harness:
        """Return a harness, which starts nothing yet."""
        return Harness(
            material=self.material,
            setup=setup or Setup(),
            command=self.command,
            cwd=self.cwd,
            logs=self.log_folder(),
            interrupt=self.interrupt,
        )

    def log_folder(self) -> Path:
        """Create and return the folder for the log of the next start."""
        self._count += 1
        folder = self._logs / f"{self._count:03d}-{self.check}"
        folder.mkdir(parents=True)
        return folder

    def play(
        self,
        feed: Feed | None = None,
        *,
        setup: Setup | None = None,
        descriptions: Mapping[str, Description] | None = None,
        play: Play | None = None,
    ) -> Trace:
        """Run all steps in lockstep, or `play` instead, and return what was published.

        Raises Skipped where even a plain run fails.
        """
        self.reference()
        steps = self.material.feed if feed is None else feed
        walk = play or (lambda harness: harness.walk(steps, 0, self.steps))
        return self._play(walk, setup, descriptions)

    def _play(
        self,
        play: Play,
        setup: Setup | None = None,
        descriptions: Mapping[str, Description] | None = None,
    ) -> Trace:
        with self.harness(setup) as harness:
            harness.meet()
            harness.start(descriptions)
            play(harness)
            harness.await_output(self.steps - 1)
            return Trace.of(harness.transcript)

    def plain(self, which: str = "plain run") -> Trace:
        """Return an undisturbed run, made once for each `which`.

        Raises Failed when the participant cannot do it.
        """
        if which not in self._traces:
            try:
                self._traces[which] = self._play(self._walk_and_log)
            except Failed as exc:
                self._traces[which] = exc
        found = self._traces[which]
        if isinstance(found, Failed):
            raise Failed(str(found))
        return found

    def _walk_and_log(self, harness: Harness) -> None:
        harness.walk(self.material.feed, 0, self.steps)
        # The check `log` reports what is not logged; the other checks still run.
        with contextlib.suppress(Failed):
            harness.await_logged()

    def reference(self) -> Trace:
        """Return the plain run; raises Skipped where there is none to compare with."""
        try:
            trace = self.plain()
        except Failed as exc:
            raise Skipped(f"needs a plain run, and `steps` fails: {exc}") from exc
        if step_problem(trace.transcript):
            raise Skipped(f"needs a plain run, and `steps` fails: {step_problem(trace.transcript)}")
        return trace

    def need_inputs(self) -> None:
        """Raise Skipped for a participant without inputs."""
        if not self.spec.inputs:
            raise Skipped("it has no inputs")

    def same(self, trace: Trace, what: str, reference: Trace | None = None) -> None:
        """Compare with the plain run, or another; what: this run, for the failure's sentence.

        Raises Failed where they differ, Skipped where any two runs do.
        """
        expected = (reference or self.reference()).ports
        found = self._difference(expected, trace.ports, what)
        if found is None:
            return
        if self.varies():
            raise Skipped("its outputs differ from run to run anyway; see `determinism`")
        raise Failed(found)

    def varies(self) -> bool:
        """Return whether two plain runs differ."""
        try:
            return self.plain().ports != self.plain("second plain run").ports
        except Failed:
            return False

    def _difference(
        self,
        expected: Mapping[int, Mapping[str, bytes]],
        given: Mapping[int, Mapping[str, bytes]],
        what: str,
    ) -> str | None:
        for step in range(0, self.steps, self.spec.every):
            for port, output in self.spec.outputs.items():
                topic = f"{self.spec.name}/{port}"
                comparison = PortComparison(topic, output.type, Tolerance())
                pair = [rows.get(step, {}).get(port) for rows in (expected, given)]
                if not comparison.take(step, *pair) and comparison.divergence is not None:
                    return comparison.divergence.text("expected", what)
        return None


def step_problem(transcript: Transcript) -> str | None:
    """Return what is wrong with the steps, names or tokens of the outputs; None: nothing."""
    return next(
        (transcript.problems[c] for c in ("P7.1", "P3.5", "P3.1") if c in transcript.problems), None
    )
