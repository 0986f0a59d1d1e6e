"""What follows a simulated run: its recording is rerun, branched or replayed, without faults."""

import dataclasses
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.execute import replay
from stepbus_orchestrator.replay.recorded import recorded_end
from stepbus_orchestrator.replay.rerun import Repeated, rerun
from stepbus_orchestrator.run import run_scenario
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import StepbusError

from .execution import Execution
from .host import SimulatedHost
from .tape import Knobs, Tape


class FollowUp(Execution):
    """Reruns, branches or replays the recording of an execution, as `then` of its tape says.

    complete: number of its complete steps. problem: why it failed; empty: it did not. new: the
    recording that it makes; None where it makes none.
    """

    writes_files = True
    """The scenario and its files are unpacked from the recording."""

    def __init__(self, execution: Execution, complete: int) -> None:
        tape, out = execution.tape, execution.out.with_name("follow_up")
        super().__init__(Tape(tape.scenario, tape.steps, Knobs()), out)
        self.problem = ""
        self.new: Path | None = None
        self._recording = execution.out / "run.mcap"
        self._complete = complete
        self._do = FOLLOW_UPS[tape.then]

    def _orchestrate(self) -> int:
        try:
            self.problem = self._do(self)
        except StepbusError as exc:
            self.problem = str(exc)
        return 0

    def run(self) -> None:
        """Do it; what runs, runs here."""
        with _hosted(self.host):
            super().run()

    def rerun(self) -> str:
        """Run the scenario of the recording again."""
        return self._made(rerun(self._recording, self.out))

    def branch(self) -> str:
        """Go on from the midst of the recording, with no change."""
        return self._branch(self._complete // 2)

    def branch_late(self) -> str:
        """Go on from the newest step of any participant.

        That is an error where others lack it, or where the branch would end before it.
        """
        try:
            at = recorded_end(Recording(self._recording))
            problem = self._branch(at)
        except RecordingFailed as exc:
            problem = str(exc)
        allowed = ("complete steps", "the recording continues after that", "would end at step")
        if any(text in problem for text in allowed):
            self.new, problem = None, ""
        return problem

    def _branch(self, at: int) -> str:
        self.host.is_star = True
        return self._made(branch(self._recording, self.out, at=at))

    def replay(self, name: str) -> str:
        """Replay a participant."""
        self.host.start_order, self.host.is_star = [name], True
        result = replay(self._recording, name, recorded=True)
        return "" if result.equal else f"{name} is not what was recorded: {result.divergence}"

    def _made(self, repeated: Repeated) -> str:
        self.new = repeated.result.recording
        return repeated.result.reason if repeated.result.exit_code else ""


FOLLOW_UPS: dict[str, Callable[[FollowUp], str]] = {
    "rerun": FollowUp.rerun,
    "branch": FollowUp.branch,
    "branch late": FollowUp.branch_late,
    "replay plant": lambda follow_up: follow_up.replay("plant"),
    "replay controller": lambda follow_up: follow_up.replay("controller"),
}
"""Name in a tape → its function, which returns the problem; empty: there is none."""


@contextmanager
def _hosted(host: SimulatedHost) -> Iterator[None]:
    """Let all that runs from a recording run on a simulated host."""

    def run(scenario: Scenario, options: run_scenario.Options, *more: Any) -> Result:
        scenario = dataclasses.replace(scenario, faults=())
        return run_scenario.run(scenario, dataclasses.replace(options, host=host), *more)

    # The package has functions of the same names.
    of_rerun, of_branch, of_replay = (
        sys.modules[item.__module__] for item in (rerun, branch, replay)
    )
    with (
        patch.object(of_rerun, "run", run),
        patch.object(of_branch, "run", run),
        patch.object(of_replay, "Processes", lambda **_options: host),
    ):
        yield
