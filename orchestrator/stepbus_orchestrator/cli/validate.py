"""`stepbus validate`: check a scenario and show its schedule."""

import argparse

from stepbus_orchestrator.cli.command import Command, add_scenario_arguments, number
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.run.describe import rehearse
from stepbus_orchestrator.scenario import Schedule, load

_SHOWN_STEPS = 5


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--steps",
        type=number("a number of steps, from 0 on", 0),
        default=_SHOWN_STEPS,
        help=f"how many steps of the schedule to show (default: {_SHOWN_STEPS})",
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    scenario = load(args.scenario, args.set, last_check=rehearse)
    schedule = Schedule.of(scenario)
    if args.json:
        say_json(
            {
                "name": scenario.name,
                "file": str(scenario.file),
                "step_ns": scenario.step_ns,
                "steps": scenario.steps,
                "order": schedule.order,
                "schedule": schedule.text(args.steps).split(),
            }
        )
        return 0
    length = "no fixed end" if scenario.steps is None else f"{scenario.steps} steps"
    say(f"{scenario.file}: valid; {length} of {scenario.step_ns * 1e-6:g} ms")
    more = scenario.steps is None or args.steps < scenario.steps
    say(schedule.text(args.steps) + (" …" if more else ""))
    return 0


COMMAND = Command(
    name="validate",
    summary="check a scenario and show its schedule",
    description="Checks a scenario without a run, and lists all problems at once, with file, line "
    "and path. If there is none, each plant loads its world once, to find what only that shows. "
    "Prints who publishes at which step.",
    examples=("stepbus validate two_link", "stepbus validate my/scenario.yaml --steps 20"),
    add_arguments=_add_arguments,
    execute=_execute,
)
