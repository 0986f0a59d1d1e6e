"""`stepbus replay`: one participant against its recording."""

import argparse

import msgspec

from stepbus_orchestrator.cli.command import Command, number
from stepbus_orchestrator.cli.diff import add_tolerance_arguments, tolerance_of
from stepbus_orchestrator.cli.live import displayed
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.cli.parameters import add_parameters, parameters_of
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.trust import add_trust, trusted_programs
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_orchestrator.replay.work_tree import find_work_tree
from stepbus_schemas import WiringError


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameters(
        parser,
        replay,
        exclusive=("recorded", "source"),
        participant={"flag": "--participant", "required": True, "metavar": "NAME"},
        tolerance=add_tolerance_arguments,
        update={"metavar": "OUT.mcap"},
        window={"type": number("a number of steps, at least 1", 1)},
        source={"metavar": "FOLDER"},
        program={"flag": "--exec", "nargs": argparse.REMAINDER, "metavar": "PROGRAM"},
        trusted=None,
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    add_trust(parser)


def _execute(args: argparse.Namespace) -> int:
    if args.program == []:
        raise WiringError("--exec: the program is missing; write it last, with its arguments")
    result = _replay(args)
    if args.json:
        say_json({**msgspec.structs.asdict(result), "steps_per_s": result.steps_per_s})
    else:
        _conclude(result)
    return ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT


def _replay(args: argparse.Namespace) -> ReplayResult:
    given = parameters_of(args, replay) | {"tolerance": tolerance_of(args, args.participant)}
    is_own = args.program is not None
    if is_own and args.source is not None:
        raise WiringError("--source: a program of --exec starts in the current folder")
    tree = (
        None
        if args.recorded or is_own
        else find_work_tree(Recording(args.recording), args.participant, args.source)
    )
    trusted = trusted_programs(args, args.participant, own_program=is_own, tree=tree)
    given |= {"recorded": tree is None, "source": None if tree is None else tree.file}
    title = f"replay of {args.participant}"
    with displayed(title, quiet=args.json) as display, interruptible() as interrupt:
        return replay(**given, trusted=trusted, observer=display, interrupt=interrupt)


def _conclude(result: ReplayResult) -> None:
    say(result.text())
    say(f"wall time {result.wall_s:.2f} s ({result.steps_per_s:.0f} steps/s)")
    if result.updated is not None:
        replaced = sum(port.within + port.different for port in result.ports)
        say(f"wrote {result.updated}: {replaced} messages of {result.participant} are new")


COMMAND = Command(
    name="replay",
    summary="run one participant against its recording and compare",
    description="Starts one participant of a recorded run, or another program in its place, feeds "
    "it exactly the recorded inputs in lockstep, and compares each output with the recorded one: "
    "byte for byte, or within a tolerance. Shows the first divergent step with its inputs. The "
    "program is that of the scenario in your work tree, if it is found there, else the copy in the "
    "recording. Exit code 0: equal, 10: different. A program that you have not run here is shown "
    "first, and needs a yes, or --trust.",
    examples=(
        "stepbus replay run.mcap --participant controller",
        "stepbus replay run.mcap --participant controller --set controller.params.kp=101",
        "stepbus replay run.mcap --participant controller --abs 1e-9 --exec ./my_controller",
        "stepbus replay run.mcap --participant controller --update new.mcap",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
