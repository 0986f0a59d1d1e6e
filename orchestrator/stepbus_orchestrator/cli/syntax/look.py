"""What is recorded: `stepbus info`, `types` and `recover`."""

from pathlib import Path

from stepbus_orchestrator.cli.parameters import File, Folder, command


@command(group="look", execute="stepbus_orchestrator.cli.info:info_command")
def info_command(recording: Path, /, *, json: bool = False) -> None:
    """Summarize a recording.

    Shows the scenario, the outcome, the length, the participants, the messages and the versions.
    Needs only the recording; result.json next to it adds outcome and wall time. For a truncated
    recording, shows where it ends.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus info runs/arm
    $ stepbus info run.mcap --json

    """


@command(group="look", execute="stepbus_orchestrator.cli.scenarios:types_command")
def types_command(source: str | None = None, /, *, out: Folder = None, json: bool = False) -> None:
    """Show message types, or write their schemas and byte vectors.

    Shows the fields of message types with units and shapes, and their layout in the bridge's raw
    format. With --out, writes test data for programs in other languages: JSON Schemas, and byte
    vectors that a codec must read and write.

    Parameters
    ----------
    source
        a scenario with its own types, a YAML file of types, or an installed module of message
        classes (default: the built-in types)
    out
        write messages.md, vectors.json and a JSON Schema for each type
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus types
    $ stepbus types types.yaml --out types

    """


@command(group="look", execute="stepbus_orchestrator.cli.recover:recover_command")
def recover_command(
    recording: Path, /, *, out: File = None, in_place: bool = False, json: bool = False
) -> None:
    """Recover a truncated or corrupt recording.

    Reads an MCAP file up to its first damaged record and writes the intact part to a new file, with
    attachments, metadata and a new index. Reports what was lost.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    out
        the file to write (default: <recording>.recovered.mcap)
    in_place
        replace the original file, in place of --out
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus recover runs/two_link-20250101-120000/run.mcap
    $ stepbus recover broken.mcap --out fixed.mcap
    $ stepbus recover broken.mcap --in-place

    """
