"""What `stepbus_orchestrator` exports."""

from stepbus_orchestrator.analysis.tolerance import AnyTolerance, Tolerance
from stepbus_orchestrator.replay import ReplayResult
from stepbus_orchestrator.replay import replay as replay_participant
from stepbus_orchestrator.replay.branch import Branch
from stepbus_orchestrator.replay.branch import branch as branch_recording
from stepbus_orchestrator.run.describe import ParticipantDescription, describe
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.folder import first_new
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, default_folder, host_of
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario import (
    Overrides,
    Problem,
    Scenario,
    ScenarioError,
    check_data,
    check_installed,
    load,
    override_texts,
    plain_value,
    yaml_text,
)

from .analysis.diff import Diff, diff
from .analysis.verify import Verification, plan, verify
from .errors import (
    BusFailed,
    Diverged,
    ExitCode,
    Interrupted,
    OutputExists,
    ParticipantDied,
    ParticipantFault,
    RecordingFailed,
    RunFailure,
    StartFailed,
    StepTimeout,
    StopTimeout,
)
from .recording.layout import Source, recording_file
from .recording.reader import Recording
from .recording.recover import Recovery, recover
from .recording.timing import StepTiming
from .replay.rerun import Rerun
from .replay.rerun import rerun as rerun_recording
from .run.episode import Episode
from .run.extension import RunExtension
from .run.extensions.external import External, as_external
from .run.extensions.real_time import RealTime
from .run.live_file import call

__all__ = [
    "AnyTolerance",
    "Branch",
    "BusFailed",
    "Diff",
    "Diverged",
    "Episode",
    "ExitCode",
    "External",
    "InProcess",
    "Interrupted",
    "Observer",
    "Options",
    "OutputExists",
    "Overrides",
    "Pace",
    "ParticipantDescription",
    "ParticipantDied",
    "ParticipantFault",
    "Problem",
    "Progress",
    "RealTime",
    "Recording",
    "RecordingFailed",
    "Recovery",
    "ReplayResult",
    "Rerun",
    "Result",
    "RunExtension",
    "RunFailure",
    "Scenario",
    "ScenarioError",
    "Source",
    "StartFailed",
    "StepTimeout",
    "StepTiming",
    "StopTimeout",
    "Tolerance",
    "Verification",
    "as_external",
    "branch_recording",
    "call",
    "check_data",
    "check_installed",
    "default_folder",
    "describe",
    "diff",
    "first_new",
    "host_of",
    "load",
    "override_texts",
    "plain_value",
    "plan",
    "recording_file",
    "recover",
    "replay_participant",
    "rerun_recording",
    "run_scenario",
    "verify",
    "yaml_text",
]
