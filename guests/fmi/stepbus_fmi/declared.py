"""The commands of this package."""

from dataclasses import KW_ONLY
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.options import Command, Scenario, Set


class ExportFmu(Command, work="export.work", group="more"):
    """Export a participant, or a whole scenario, as an FMU.

    The FMU is for co-simulation, by FMI 2.0 or 3.0. That of a participant, a class in Python, has
    the numbers of its inputs and outputs as variables. That of a scenario has the outputs of all
    participants; with --input, its importer plays one of them. It needs a Python in which stepbus
    is installed (docs/guide/writing/fmu_export.md).

    $ stepbus export-fmu two_link/pd controller --out controller.fmu
    $ stepbus export-fmu two_link --out two_link.fmu --fmi 3
    $ stepbus export-fmu two_link --input controller --out plant.fmu
    """

    scenario: Scenario
    participant: Annotated[str, Parameter(metavar="PARTICIPANT")] = ""
    """the participant that becomes an FMU (default: all of the scenario)"""
    _: KW_ONLY
    out: Annotated[Path, Parameter(metavar="FILE")]
    """the new file, such as controller.fmu"""
    fmi: Literal["2", "3"] = "2"
    """version of FMI"""
    input: Annotated[str, Parameter(metavar="PARTICIPANT")] = ""
    """of a whole scenario: the participant whose outputs are the inputs of the FMU"""
    set: Set = ()
