"""From another terminal: `stepbus join`, `bridge` and `call`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import Duration, command


@command(group="attach", execute="stepbus_orchestrator.cli.attach:join_command")
def join_command(ticket: Path, /, *program: str, wait: Annotated[float, Duration] = 60.0) -> None:
    """Start a participant of a run from another terminal, container or debugger.

    Waits for the run of a ticket, then runs the program in this terminal, with the arguments and
    environment that the run would have used (including the bridge). The run must expect it:
    `stepbus run --external NAME`, or `start: external` in the scenario. You can start either one
    first (docs/guide/running/attach.md). Exits with the program's exit code.

    Parameters
    ----------
    ticket
        the ticket, whose path the run prints
    program
        command line of the program, after `--`; default: the one in the scenario
    wait
        how long to wait for the run (default: 60s)

    Examples
    --------
    $ stepbus join runs/two_link-20260101-120000/controller.ticket
    $ stepbus join /tmp/c.ticket -- python my_controller.py
    $ stepbus join --wait 10min /tmp/c.ticket -- python -m pdb my_controller.py

    """


@command(group="attach", execute="stepbus_orchestrator.cli.attach:bridge_command")
def bridge_command(
    *program: str,
    format: Literal["json", "msgpack", "raw"] = "json",
    describe: Annotated[str, Parameter(metavar="JSON")] = "",
) -> None:
    """Connect a program to a run through the bridge.

    Joins a run with the ticket in STEPBUS_TICKET, starts a program, and exchanges every step with
    it over file descriptors 3 and 4 (docs/guide/writing/bridge.md). A scenario starts it with the
    key `bridge`, or explicitly: `exec: [stepbus, bridge, --format, json, --, node,
    controller.mjs]`.

    Parameters
    ----------
    program
        command line of the program, after `--`
    format
        format of the messages
    describe
        descriptions of the outputs, e.g. {"command": {"like": "joint_state"}}

    Examples
    --------
    $ stepbus bridge --format json -- node controller.mjs
    $ stepbus bridge --format raw -- octave-cli --quiet controller.m

    """


@command(group="attach", execute="stepbus_orchestrator.cli.attach:call_command")
def call_command(
    run: Path,
    participant: str = "",
    method: str = "",
    /,
    *args: Annotated[str, Parameter(name="ARG")],
    json: bool = False,
) -> None:
    """Call a method of a participant in a live run.

    Calls a method of a participant in a live run, from a second terminal. The participant answers
    between two steps. A call that only reads does not affect the result. A call that changes the
    run is recorded with its step; rerun, replay and branch repeat it at that step.

    Parameters
    ----------
    run
        folder of a live run
    participant
        participant to call, or `run` for the run itself; without it, lists all methods
    method
        method to call
    args
        arguments, as YAML values
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus call runs/arm
    $ stepbus call runs/arm plant joint_position joint1
    $ stepbus call runs/arm plant set_joint_position joint1 0.5
    $ stepbus call runs/arm mission set_target joint1 30deg 0.5
    $ stepbus call runs/arm controller set kp 90
    $ stepbus call runs/arm run pause

    """
