"""`stepbus recover`: rebuild a recording that is cut off or corrupt."""

import argparse
from pathlib import Path

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.recording import Recovery, layout, recover


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recording", type=Path, help="the MCAP file to read, or the folder of a run"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--out", type=Path, help="the file to write (default: <recording>.recovered.mcap)"
    )
    where.add_argument("--in-place", action="store_true", help="replace the file that was read")
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    source = layout.recording_file(args.recording)
    target = args.out or source.with_name(f"{source.stem}.recovered.mcap")
    recovery = recover(source, source if args.in_place else target, in_place=args.in_place)
    if args.json:
        say_json({**vars(recovery), "missing_steps": recovery.missing_steps})
    else:
        for line in _lines(recovery):
            say(line)
    return 0


def _lines(recovery: Recovery) -> list[str]:
    """Return what was kept and what was lost, in sentences."""
    kept = f"{recovery.messages} messages up to step {recovery.last_step}"
    state = recovery.damage or ("it has holes" if recovery.holes else "undamaged")
    if recovery.cut_step is not None:
        state = recovery.damage or "it ends in the midst of a step"
    lines = [
        f"{recovery.source}: {state}",
        (
            f"kept {kept if recovery.messages else 'no messages'}; attachments: "
            f"{recovery.attachments}, metadata records: {recovery.metadata}"
        ),
    ]
    if recovery.cut_step is not None:
        lines.append(layout.incomplete(recovery.cut_step))
    if recovery.damage:
        lines.append(_loss(recovery))
    lines += [f"hole: {hole}" for hole in recovery.holes]
    return [*lines, f"wrote {recovery.target}"]


def _loss(recovery: Recovery) -> str:
    if recovery.only_index_lost:
        return f"lost nothing but the index ({recovery.lost_bytes} bytes), which was rebuilt"
    lost = f"lost the {recovery.lost_bytes} bytes from byte {recovery.kept_bytes} on"
    if recovery.planned_steps is None:
        return lost
    return (
        f"{lost}; {recovery.missing_steps} of the scenario's {recovery.planned_steps} steps "
        "are missing"
    )


COMMAND = Command(
    name="recover",
    summary="rebuild a recording that is cut off or corrupt",
    description="Reads an MCAP file up to its first damaged record and writes what it read to a "
    "new file, with attachments, metadata and a new index. Reports what was lost.",
    examples=(
        "stepbus recover runs/two_link-20250101-120000/run.mcap",
        "stepbus recover broken.mcap --out fixed.mcap",
        "stepbus recover broken.mcap --in-place",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
