"""The command of this package."""

from dataclasses import KW_ONLY

from stepbus_orchestrator.cli.options import (
    Command,
    Duration,
    Folder,
    NoReport,
    Port,
    Scenario,
    Set,
    Texts,
)


class Coppelia(Command, work="work", group="run", is_run=True):
    """Run a script for CoppeliaSim's remote API.

    Takes the plant of a scenario, listens as CoppeliaSim does, and starts the script, in any
    language. Its calls drive the plant: with sim.setStepping(True), each sim.step() is a step;
    otherwise the run keeps to the wall clock. Each sim.startSimulation is a run of its own, which
    is recorded, and which rerun, replay, diff and branch take like any other. Without a script, it
    waits for one that you start in another terminal (docs/guide/writing/coppeliasim.md).

    $ stepbus coppelia two_link -- python my_script.py
    $ stepbus coppelia my/scenario.yaml --out runs/mine -- octave-cli my_script.m
    $ stepbus coppelia two_link
    """

    scenario: Scenario
    script: Texts = ()
    """command line of the script, after `--`"""
    _: KW_ONLY
    set: Set = ()
    port: Port = 23000
    """port of the ZeroMQ remote API; 0: any that is free, which the script finds in
    STEPBUS_COPPELIA_PORT"""
    legacy_port: tuple[Port, ...] = ()
    """port of the legacy remote API (simx…); may be repeated (default: 19997; 0: any)"""
    start: bool = False
    """start the simulation when the script connects, as if you had pressed CoppeliaSim's button"""
    client_timeout: Duration = ""
    """how long a client that steps the simulation may keep it from its next step (default: 30s)"""
    out: Folder = None
    """folder of the first run (default: runs/<name>-<time>)"""
    no_report: NoReport = False
    view: bool = False
    """show each live run in 3D in the browser"""
    no_open: bool = False
    """with --view, do not open a browser"""
