"""Checks, and their common ground: a harness for each start, a plain run to compare with."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from stepbus_orchestrator.analysis.divergence import PortComparison
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_participant import make_new_folder
from stepbus_schemas import Description
from stepbus_tools.conformance.harness import Harness, Hook
from stepbus_tools.conformance.material import Feed, Material, Setup
from stepbus_tools.conformance.transcript import Failed, Skipped, Transcript

Play = Callable[[Harness], None]


@dataclass(kw_only=True)
class Kit:
    """One participant under test.

    material: the played messages. command: its command line. cwd: where it is started. logs:
    gets a folder for each start of it. interrupt: ends everything when it is set. is_scenarios:
    whether it is the scenario's own program. knows_names: whether it learns the names of its
    inputs; not through the raw bridge. is_plain_checked: whether the check `steps` says what is
    wrong with a plain run, so that the others need not. check: name of the check that runs.
    """

    material: Material
    command: Sequence[str]
    cwd: Path
    logs: Path
    interrupt: threading.Event
    is_scenarios: bool = False
    knows_names: bool = True
    is_plain_checked: bool = True
    check: str = ""
    _count: int = 0
    _plain: dict[str, Transcript | Failed] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.spec = self.material.spec
        self.feed = self.material.feed
        self.steps = self.material.steps
        self.types = self.material.scenario.types

    @property
    def middle(self) -> int:
        """Return a step in the middle at which the participant and all its sources fire."""
        firing = [self.spec.every, *map(self.every, self.feed)]
        common = [s for s in range(self.steps) if not any(s % every for every in firing)]
        return common[len(common) // 2]

    def every(self, source: str) -> int:
        """Return at multiples of which step a source fires."""
        return self.material.scenario.participant(source).every

    # --- starting it -------------------------------------------------------------------------

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
        folder = self.logs / f"{self._count:03d}-{self.check}"
        make_new_folder(folder)
        return folder

    @contextlib.contextmanager
    def joined(self, setup: Setup | None = None, *, has_peers: bool = False) -> Iterator[Harness]:
        """Yield a harness whose program has asked to join; has_peers: their own end is open."""
        with self.harness(setup) as harness:
            harness.open_bus()
            if has_peers:
                harness.open_peers()
            harness.start_program()
            harness.await_join()
            yield harness

    @contextlib.contextmanager
    def running(
        self,
        end: int | None = 0,
        setup: Setup | None = None,
        descriptions: Mapping[str, Description] | None = None,
    ) -> Iterator[Harness]:
        """Yield a harness whose program has done the steps below `end`; None: it is ready."""
        has_peers = setup is not None and setup.own_peers
        with self.joined(setup, has_peers=has_peers) as harness:
            harness.await_ready()
            if end is not None:
                harness.start(descriptions)
                harness.walk(self.feed, 0, end)
            yield harness

    # --- runs to compare ---------------------------------------------------------------------

    def play(
        self,
        feed: Feed | None = None,
        *,
        setup: Setup | None = None,
        descriptions: Mapping[str, Description] | None = None,
        play: Play | None = None,
        **hooks: Hook,
    ) -> Transcript:
        """Run all steps in lockstep, with hooks as of `walk`, or `play`; return the transcript.

        Raises as `reference` where even a plain run fails.
        """
        self.reference()
        rows = self.feed if feed is None else feed
        walk = play or (lambda harness: harness.walk(rows, 0, self.steps, **hooks))
        return self._play(walk, setup, descriptions)

    def _play(
        self,
        play: Play,
        setup: Setup | None = None,
        descriptions: Mapping[str, Description] | None = None,
    ) -> Transcript:
        with self.running(0, setup, descriptions) as harness:
            play(harness)
            harness.await_output(self.steps - 1)
            return harness.transcript

    def unchanged(self, what: str, feed: Feed | None = None, **options: Any) -> str:
        """Run as `play` does and compare with the plain run; what, raises: as of `same`."""
        self.same(self.play(feed, **options), what)
        return "the same outputs"

    def plain(self, which: str = "plain run") -> Transcript:
        """Return an undisturbed run, made once for each `which`.

        Raises Failed when the participant cannot do it.
        """
        if which not in self._plain:
            try:
                self._plain[which] = self._play(self._walk_and_log)
            except Failed as exc:
                self._plain[which] = exc
        made = self._plain[which]
        if isinstance(made, Failed):
            raise Failed(str(made))
        return made

    def _walk_and_log(self, harness: Harness) -> None:
        harness.walk(self.feed, 0, self.steps)
        # The check `log` reports what is not logged; the other checks still run.
        with contextlib.suppress(Failed):
            harness.await_logged()

    def reference(self) -> Transcript:
        """Return the plain run; raises Skipped, or Failed, where there is none to compare with."""
        try:
            transcript = self.plain()
            problem = transcript.step_problem
        except Failed as exc:
            problem = str(exc)
        if problem:
            wrong = Skipped if self.is_plain_checked else Failed
            raise wrong(f"needs a plain run, but `steps` fails: {problem}")
        return transcript

    def same(self, given: Transcript, what: str, expected: Transcript | None = None) -> None:
        """Compare with the plain run, or another; what: this run, for the failure's sentence.

        Raises Failed where they differ, Skipped where any two runs do.
        """
        pair = [(expected or self.reference()).ports(), given.ports()]
        for step in range(0, self.steps, self.spec.every):
            for port, output in self.spec.outputs.items():
                topic = f"{self.spec.name}/{port}"
                comparison = PortComparison(topic, output.type, Tolerance(), self.types)
                comparison.take(step, *(rows.get(step, {}).get(port) for rows in pair))
                if comparison.divergence is not None:
                    self.differ(comparison.divergence.text("expected", what))

    def differ(self, text: str) -> NoReturn:
        """Raise Failed for runs that differ; Skipped where any two runs do."""
        self.skip_if_varies()
        raise Failed(text)

    def skip_if_varies(self) -> None:
        """Raise Skipped where two plain runs differ."""
        with contextlib.suppress(Failed):
            if self.plain().ports() != self.plain("second plain run").ports():
                raise Skipped("its outputs differ between runs; see `determinism`")


Run = Callable[[Kit], str]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One demand of the protocol.

    name: for `--only`. clause: of docs/protocol.md. summary: what is demanded. run: returns what
    it observed; raises Failed or Skipped. inputs, plain: whether it is skipped for a participant
    without inputs, or without a plain run to compare with.
    """

    name: str
    clause: str
    summary: str
    run: Run
    inputs: bool = False
    plain: bool = False


def check(
    clause: str, summary: str, *, inputs: bool = False, plain: bool = False
) -> Callable[[Run], Check]:
    """Make a function a `Check`, which has its name."""

    def make(run: Run) -> Check:
        name = run.__name__.strip("_").replace("_", "-")
        return Check(name=name, clause=clause, summary=summary, run=run, inputs=inputs, plain=plain)

    return make
