"""Scenarios: what takes part in a run, how it is coupled, and whether that can work."""

from stepbus_orchestrator.scenario.check import check_classes
from stepbus_orchestrator.scenario.earlier import upgraded
from stepbus_orchestrator.scenario.extend import read_data
from stepbus_orchestrator.scenario.locate import builtin_names, scenario_folders
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_participant.parameters import Problem

from .faults import FAULT_TYPES, MESSAGE_FAULTS, PROCESS_FAULTS, faults_of, format_fault, read_fault
from .load import check_data, load
from .model import (
    EXTERNAL_SPAWN_S,
    BridgeSpec,
    BusSpec,
    Deadlines,
    FaultSpec,
    HoldSpec,
    InputSpec,
    OutputSpec,
    ParticipantSpec,
    Scenario,
    low_latency,
)
from .override import Overrides, override, override_texts, plain_value, yaml_text
from .program import (
    NEEDS,
    check_installed,
    command,
    missing,
    programs_in,
    replaced_program,
    start_command,
)
from .resolve import resolved
from .schedule import Schedule

__all__ = [
    "EXTERNAL_SPAWN_S",
    "FAULT_TYPES",
    "MESSAGE_FAULTS",
    "NEEDS",
    "PROCESS_FAULTS",
    "BridgeSpec",
    "BusSpec",
    "Deadlines",
    "FaultSpec",
    "HoldSpec",
    "InputSpec",
    "OutputSpec",
    "Overrides",
    "ParticipantSpec",
    "Problem",
    "Scenario",
    "Schedule",
    "builtin_names",
    "check_classes",
    "check_data",
    "check_installed",
    "command",
    "faults_of",
    "find_files",
    "format_fault",
    "load",
    "low_latency",
    "missing",
    "override",
    "override_texts",
    "plain_value",
    "programs_in",
    "read_data",
    "read_fault",
    "replaced_program",
    "resolved",
    "scenario_folders",
    "start_command",
    "upgraded",
    "yaml_text",
]
