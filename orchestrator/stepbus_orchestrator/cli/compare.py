"""`stepbus diff` and `replay`: two recordings, or one participant and its recording."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import Tolerance, parse_tolerance, read_tolerance
from stepbus_orchestrator.cli.parameters import RECORDING, Json, Trust, command, number
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.cli.trust import check_trust
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_schemas import WiringError

Limits = Annotated[Sequence[str], {"metavar": "[PORT[.FIELD]=]NUMBER"}]


@dataclass(frozen=True, kw_only=True)
class ToleranceOptions:
    """How far values may differ.

    abs: absolute tolerance, e.g. 1e-9. rel: relative tolerance. ignore: ignore a port or field.
    tolerance: YAML file of tolerances (docs/guide/testing/replay.md).
    """

    abs: Limits = ()
    rel: Limits = ()
    ignore: Annotated[Sequence[str], {"metavar": "PORT[.FIELD]"}] = ()
    tolerance: Annotated[Path | None, {"metavar": "FILE"}] = None

    def read(self, participant: str = "") -> Tolerance:
        """Return the tolerance; the command line takes precedence over the file."""
        from_file = Tolerance() if self.tolerance is None else read_tolerance(self.tolerance)
        return from_file | parse_tolerance(self.abs, self.rel, self.ignore, participant)


@command(group="test", of=diff, hidden=["is_part"], first=RECORDING, second=RECORDING)
def diff_command(*, tolerance: ToleranceOptions, **given: Any) -> Answer:
    """Compare two recordings, port by port.

    Compares the messages of two recordings byte for byte, or within a tolerance. The recordings may
    differ in length or be truncated. Shows the first difference first. PORT is a topic such as
    controller/command. Exit code 0: equal, 10: different.

    $ stepbus diff runs/a/run.mcap runs/b/run.mcap
    $ stepbus diff a.mcap b.mcap --abs controller/command.values=1e-9
    $ stepbus diff a.mcap b.mcap --tolerance tolerance.yaml --json
    """
    difference = diff(**given, tolerance=tolerance.read())
    code = ExitCode.FINISHED if difference.equal else ExitCode.DIFFERENT
    return Answer(value=difference, lines=[difference.text()], code=code)


@command(
    group="test",
    of=replay,
    exclusive=["recorded", "source"],
    is_run=True,
    recording=RECORDING,
    participant={"flag": "--participant", "metavar": "NAME"},
    update={"metavar": "OUT.mcap"},
    window={"type": number("not a number of steps (1 or more)", 1)},
    source={"metavar": "FOLDER"},
    program={
        "flag": "--exec",
        "action": "store",
        "nargs": argparse.REMAINDER,
        "default": None,
        "metavar": "PROGRAM",
    },
)
def replay_command(
    *, tolerance: ToleranceOptions, trust: Trust = False, json: Json = False, **given: Any
) -> Answer:
    """Run one participant on its recorded inputs and compare its outputs.

    Starts one participant of a recorded run, or another program in its place, feeds it the recorded
    inputs in lockstep, and compares each output with the recorded one: byte for byte, or within a
    tolerance. Shows the first divergent step with its inputs. Uses the program of the scenario in
    --source, or else the copy in the recording. Exit code 0: equal, 10: different. A recorded
    program that differs from yours starts only with --trust.

    $ stepbus replay run.mcap --participant controller
    $ stepbus replay runs/arm --participant controller --set controller.params.kp=9
    $ stepbus replay runs/arm --participant controller --abs 1e-9 --exec ./mine
    $ stepbus replay run.mcap --participant controller --update new.mcap
    """
    recording, participant, program = (given[n] for n in ("recording", "participant", "program"))
    if program == []:
        raise WiringError("--exec: no program given; write it last, with its arguments")
    if program and given["source"]:
        raise WiringError(
            "--source cannot be combined with --exec, whose program starts in the current folder"
        )
    is_copy = given["recorded"] or bool(program)
    source = None if is_copy else find_source(Recording(recording), given["source"])
    given |= {"recorded": source is None, "source": source}
    given["tolerance"] = tolerance.read(participant)
    if source is None:
        check_trust(Recording(recording), participant, trust=trust, own_program=bool(program))
    with (
        displayed(f"replay of {participant}", quiet=json) as display,
        interruptible() as interrupt,
    ):
        result = replay(**given, observer=display, interrupt=interrupt)
    return Answer(
        value={**msgspec.structs.asdict(result), "steps_per_s": result.steps_per_s},
        lines=_replayed(result),
        code=ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT,
    )


def _replayed(result: ReplayResult) -> Iterator[str]:
    yield result.text()
    yield f"wall time {result.wall_s:.2f} s ({result.steps_per_s:.0f} steps/s)"
    if result.updated is not None:
        replaced = sum(port.within + port.different for port in result.ports)
        yield f"wrote {result.updated}: replaced {replaced} messages of {result.participant}"
