"""What `stepbus_orchestrator` exports."""

from stepbus_orchestrator.run.describe import ParticipantDescription, describe
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.folder import first_new
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, default_folder, host_of
from stepbus_orchestrator.run.run_scenario import run as run_scenario

from .analysis.comparison import Tolerance, parse_tolerance, read_tolerance
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
from .recording.reader import Recording
from .recording.recover import Recovery, recover
from .recording.timing import StepTiming
from .replay import ReplayResult
from .replay import replay as replay_participant
from .replay.branch import Branch
from .replay.branch import branch as branch_recording
from .replay.rerun import Preparation, Rerun
from .run.episode import Episode
from .run.extension import RunExtension
from .run.extensions.external import External, as_external
from .run.extensions.real_time import RealTime
from .run.live_file import call
from .scenario import Problem, Scenario, ScenarioError, check_data, check_installed, load

__all__ = [
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
    "Pace",
    "ParticipantDescription",
    "ParticipantDied",
    "ParticipantFault",
    "Preparation",
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
    "parse_tolerance",
    "plan",
    "read_tolerance",
    "recover",
    "replay_participant",
    "run_scenario",
    "verify",
]
