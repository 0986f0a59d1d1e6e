"""Variants of a branch: every value of what is varied, each with those of all others."""

import itertools
import json
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

from stepbus_orchestrator.analysis.diff import Diff, diff
from stepbus_orchestrator.recording import Checkpoints, Recording, SavedState
from stepbus_orchestrator.recording.layout import Source, recording_file
from stepbus_orchestrator.replay.plan import Change, Plan, choose, plan, to_be_made
from stepbus_orchestrator.replay.prefix import RecordedPrefix
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result, file_sha256
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import Overrides, override_texts
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_MOST = 100
_UNFIT = re.compile(r"[^A-Za-z0-9._=+-]+")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One variant. name: `kp=50`, or `kp=50, kd=2`. folder: a name for its folder."""

    name: str
    overrides: Sequence[str]

    @property
    def folder(self) -> str:
        """Return its name without what a folder's should not have."""
        return _UNFIT.sub("_", self.name.replace(", ", ","))


def variants(texts: Sequence[str]) -> list[Variant]:
    """Return the variants of texts such as `controller.params.kp=50,100,200`.

    Raises WiringError for one that names no values, or where they are too many together.
    """
    rows = [_values(text) for text in texts]
    given = [
        Variant(
            name=", ".join(f"{path.rpartition('.')[2]}={value}" for path, value in chosen),
            overrides=[f"{path}={value}" for path, value in chosen],
        )
        for chosen in itertools.islice(itertools.product(*rows), _MOST + 1)
    ]
    if len(given) > _MOST:
        raise WiringError(f"--vary: more than {_MOST} variants")
    if len({variant.folder for variant in given}) < len(given):
        raise WiringError("--vary: two variants are the same")
    return given


def _values(text: str) -> list[tuple[str, str]]:
    path, _, values = text.partition("=")
    # As YAML has a list, so that a value may be one itself.
    parsed = parse_yaml(text, f"[{values}]") if path.strip() and values.strip() else []
    if not parsed:
        raise WiringError(
            f"--vary {text!r}: write PATH=VALUE,VALUE…, e.g. controller.params.kp=50,100"
        )
    return [(path.strip(), json.dumps(value, ensure_ascii=False)) for value in parsed]


@dataclass(frozen=True, kw_only=True)
class Branch:
    """A run whose first steps are those of a recording.

    at: the first step that is not. changed: participants whose own outputs count from there on
    only. recorded_sha256: of the recording. way_s: how long the run took to get to `at` [s]; 0
    where it did not get there. restored: participants that started from a checkpoint, each with its
    step; all others started at step 0.
    """

    recording: Path
    at: int
    changed: Sequence[str]
    recorded_sha256: str
    way_s: float
    result: Result
    restored: Mapping[str, int] = field(default_factory=dict)
    notes: Sequence[str] = field(default=())

    @property
    def equal(self) -> bool:
        """Return whether the new recording is the old one, byte for byte."""
        return self.recorded_sha256 == self.result.sha256

    def diff(self) -> Diff:
        """Compare it with the recording: of one that is cut off, up to its end."""
        with Recording(self.recording) as recording:
            is_part = bool(recording.cut_short)
        return diff(self.recording, self.result.recording, is_part=is_part)


class BranchPlan:
    """A branch that is about to start; the recording's files are unpacked in `out/source`.

    Arguments as of `branch`; trusted: fingerprint of the programs that may be started, None: any.
    scenario: what runs. notes: what may make it different from the recording.

    Raises RecordingFailed when the recording does not go so far, or `out` holds a run already;
    ScenarioError when the scenario cannot run here; WiringError for a change that no branch can
    make.
    """

    def __init__(
        self,
        recording: Path,
        at: int | str,
        out: Path,
        overrides: Sequence[str] = (),
        *,
        faults: Sequence[str] = (),
        calls: Sequence[str] = (),
        trusted: str | None = None,
        checkpoints: bool = True,
    ) -> None:
        opened = Recording(recording)
        change = Change(overrides=overrides, faults=faults, calls=calls)
        self._plan: Plan = plan(opened, at, out, change, trusted)
        self._sha256 = file_sha256(opened.path)
        self._restored: Mapping[str, SavedState] = {}
        if checkpoints:
            saved = Checkpoints(opened.path, self._sha256)
            self._restored = choose(saved, self._plan)
            self._plan.notes.extend(saved.problems)
        self._recording = opened
        self._out = out
        self.scenario: Scenario = self._plan.scenario
        self.notes: Sequence[str] = self._plan.notes

    @property
    def at(self) -> int:
        """Return the first live step."""
        return self._plan.at

    def run(
        self,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        *,
        debug: Sequence[str] = (),
        in_process: bool = False,
        owns_descriptors: bool = False,
    ) -> Branch:
        """Run; arguments as of `stepbus run`. A run that fails has its failure in `result`."""
        planned = self._plan
        restored = self._restored
        prefix = RecordedPrefix(self._recording, planned.at, planned.counts_from, restored)
        options = Options(
            out=self._out,
            host=host_of(in_process=in_process, owns_descriptors=owns_descriptors),
            extensions=[
                prefix,
                Calls(to_be_made(planned.calls, restored), planned.new_calls),
                Debug(debug),
            ],
        )
        result = run(self.scenario, options, observer, interrupt)
        return Branch(
            recording=self._recording.path,
            at=planned.at,
            changed=planned.changed,
            recorded_sha256=self._sha256,
            way_s=prefix.took_s,
            result=result,
            restored={name: item.step for name, item in restored.items()},
            notes=self.notes,
        )


def branch(
    recording: Source,
    out: str | PathLike[str],
    *,
    at: int | str,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    calls: Sequence[str] = (),
    faults: Sequence[str] = (),
    in_process: bool = False,
    checkpoints: bool = True,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Branch:
    """Take a recording up to a step, and go on from there live, with a change.

    Below `at`, each participant gets its recorded inputs; the first that does not publish what is
    recorded is named in `result`.

    recording: the run.mcap of a run, or its folder. out: folder of the new run. at: the first live
    step, or its time, e.g. 6s. set: change a parameter from that step on, e.g.
    controller.params.kp=90; may be repeated. A changed participant's own outputs count from `at`
    on. calls: call a participant before that step, e.g. 'controller set kp 90'; may be repeated.
    faults: inject a fault at that step or later, e.g. 'freeze plant at 1300 for 200ms'. in_process:
    host all participants in one process: quicker, the same recording. checkpoints: whether
    participants start from the newest state that the run has saved, instead of step 0. observer,
    interrupt: as of `run`.

    Raises RecordingFailed when the recording does not go so far, or `out` holds a run already;
    ScenarioError when the scenario cannot run here; WiringError for a change that no branch can
    make.
    """
    prepared = BranchPlan(
        recording_file(recording),
        at,
        Path(out),
        override_texts(set),
        faults=faults,
        calls=calls,
        checkpoints=checkpoints,
    )
    return prepared.run(observer, interrupt, in_process=in_process)
