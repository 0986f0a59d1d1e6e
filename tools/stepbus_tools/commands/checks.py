"""What is checked: `stepbus conformance` a program, `doctor` this machine, `selftest` a plant."""

from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import (
    File,
    Folder,
    ScenarioName,
    Set,
    Texts,
    command,
)


@command(group="test", execute="stepbus_tools.commands.checking:conformance_command", is_run=True)
def conformance_command(
    *program: str,
    bridge: Literal["json", "msgpack", "raw"] | None = None,
    scenario: ScenarioName = "two_link",
    participant: Annotated[str, Parameter(metavar="NAME")] = "controller",
    set: Set = (),
    only: Annotated[Texts, Parameter(metavar="NAME")] = (),
    list: bool = False,
    logs: Folder = None,
    junit: File = None,
    json: bool = False,
) -> None:
    """Check a program against the protocol.

    Simulates the orchestrator and all peers of one participant, on the real bus, and checks the
    participant's behaviour: 65 checks, each of one clause of docs/protocol.md. Restarts the program
    for each check. Exit code 0: no check failed, 11: at least one failed.

    Parameters
    ----------
    program
        command line of the program, after `--`, started in the current folder (default: the one in
        the scenario)
    bridge
        start it through `stepbus bridge`
    scenario
        scenario that defines the ports
    participant
        participant that the program implements
    set
        override one value of the scenario, e.g. controller.step_timeout=10s
    only
        run this check; may be repeated
    list
        list the checks and start nothing
    logs
        keep the program's logs
    junit
        write JUnit XML
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus conformance -- ./my_controller
    $ stepbus conformance --bridge json -- node controller.mjs
    $ stepbus conformance --only windows --only determinism -- ./my_controller
    $ stepbus conformance --scenario my/scenario.yaml --participant plant
    $ stepbus conformance --list

    """


@command(group="test", execute="stepbus_tools.commands.checking:doctor_command")
def doctor_command(*, json: bool = False) -> None:
    """Check this machine: versions, bus, disk, extras.

    Checks versions, native libraries, the bus (with a message), disk space and missing
    extras. Exit code 1: something is broken.

    Parameters
    ----------
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus doctor

    """


@command(group="test", execute="stepbus_tools.commands.checking:selftest_command", is_run=True)
def selftest_command(
    scenario: ScenarioName,
    /,
    *,
    set: Set = (),
    angle: Annotated[float, Parameter(metavar="DEGREES")] = 90,
    json: bool = False,
) -> None:
    """Move every joint to a known angle and read it back.

    Runs the plant of a scenario without its controller and mission. Moves one joint at a time to
    90° and to -90°, or as far as its limits allow, and checks that this joint moves, in the
    commanded direction, by the commanded angle, within its limits, and that no other joint moves. A
    joint passes if it reaches one side: on the other side the robot may collide with itself. Joints
    in torque mode are pushed forward and back, then set to the angle. Exit code 0: every joint
    passes, 11: at least one fails; otherwise those of `stepbus run`.

    Parameters
    ----------
    scenario
        a scenario file, a folder with a scenario.yaml, or a built-in scenario such as two_link or
        two_link/pd
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    angle
        target angle, limited by the range of each joint
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus selftest two_link
    $ stepbus selftest baxter --angle 30
    $ stepbus selftest two_link --json

    """
