"""`stepbus plot`: any signals of a recording, in one picture."""

import argparse
from pathlib import Path

from stepbus_orchestrator.cli import Command, add_recording, say
from stepbus_orchestrator.recording import Recording
from stepbus_participant import ExtraMissing, extra_hint
from stepbus_tools.report.signals_plot import (
    draw_signals,
    find_signals,
    signal_names,
)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording(parser)
    parser.add_argument(
        "signals",
        nargs="*",
        metavar="SIGNAL",
        help="PARTICIPANT.PORT, with .FIELD, with [INDEX] or [JOINT] (none: list all signals)",
    )
    parser.add_argument(
        "--out", type=Path, help="the picture: .png, .svg or .pdf (default: beside the recording)"
    )


def _execute(args: argparse.Namespace) -> int:
    with Recording(args.recording) as recording:
        if not args.signals:
            for name in signal_names(recording):
                say(name)
            return 0
        signals = [signal for text in args.signals for signal in find_signals(recording, text)]
        target = args.out or recording.path.with_name("plot.png")
        try:
            draw_signals(str(recording.path), signals, target)
        except ImportError as exc:
            name = exc.name or ""
            raise ExtraMissing(f"plots need {name}{extra_hint(name)}") from exc
    say(f"wrote {target}")
    return 0


COMMAND = Command(
    name="plot",
    summary="plot any signals of a recording",
    description="Draws signals of a recording over simulation time, one panel each, in one "
    "picture. A port stands for all of its numbers. Without a signal, it lists those that the "
    "recording has.",
    examples=(
        "stepbus plot run.mcap controller.command plant.joint_state.position[0]",
        "stepbus plot runs/arm plant.joint_state.velocity[joint2] --out velocity.svg",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
