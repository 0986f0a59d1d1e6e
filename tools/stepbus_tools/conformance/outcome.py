"""The result of one check, and the report on all of them."""

from typing import Literal

import msgspec

from stepbus_schemas import StepbusError

Outcome = Literal["pass", "fail", "skipped"]


class Failed(StepbusError, AssertionError):
    """A participant did not do what the protocol demands; the text says what was observed."""


class Skipped(StepbusError):
    """A check does not apply to this participant, or cannot be judged; the text says why."""


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check.

    name, clause, summary: of the check. observed: one sentence. wall_s: how long it took [s].
    """

    name: str
    clause: str
    summary: str
    outcome: Outcome
    observed: str
    wall_s: float


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The results of all checks.

    scenario, participant: whose ports were played. program: its command line. steps: length of
    the recorded inputs [steps].
    """

    scenario: str
    participant: str
    program: tuple[str, ...]
    steps: int
    checks: tuple[CheckResult, ...]

    def count(self, outcome: Outcome) -> int:
        """Return how many checks had an outcome."""
        return sum(check.outcome == outcome for check in self.checks)

    @property
    def conforms(self) -> bool:
        """Return whether no check failed."""
        return self.count("fail") == 0

    @property
    def wall_s(self) -> float:
        """Return how long all checks took [s]."""
        return sum(check.wall_s for check in self.checks)
