"""A scenario as a Gymnasium environment: the policy is one of its participants."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import itertools
import math
import os
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import gymnasium
import msgspec
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box

import stepbus
from stepbus.runs import AnyScenario
from stepbus_gym.interface import Params, PolicyPorts, Vector, bounds
from stepbus_gym.policy import PolicyParticipant, checked_action
from stepbus_gym.render import Camera, Renderer
from stepbus_orchestrator.errors import RecordingFailed, RunFailure
from stepbus_orchestrator.run.episode import Episode, collect_garbage
from stepbus_orchestrator.run.folder import LOGS_FOLDER, first_new
from stepbus_orchestrator.run.inprocess.heartbeat import Heartbeat
from stepbus_orchestrator.run.inprocess.watch import watched_memory
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import Overrides, override_texts
from stepbus_participant import Config, Step, suggest
from stepbus_schemas import RunError, WiringError, error_text

Mode = Literal["torque", "velocity", "position"]
Limits = Mapping[str, tuple[float, float]]
_METADATA: dict[str, Any] = {"render_modes": ["rgb_array"]}


class Moment(msgspec.Struct, frozen=True, kw_only=True):
    """What a reward is made of.

    step: of the scenario, and t: its time [s], of the observation. observation: after the action.
    action: as it was given. inputs: port → newest message; None: there is none yet.
    """

    step: int
    t: float
    observation: Vector
    action: Vector
    inputs: Mapping[str, Any]


class StepbusEnv(gymnasium.Env[Vector, Vector]):
    """An environment in which the policy takes the place of a participant.

    scenario: as of `stepbus.load`. participant: whose inputs are observed, and whose outputs are
    the actions. reward: returns the reward of a moment. terminated: returns whether an episode
    ends there; default: never. It is truncated at the scenario's duration. duration: another one,
    such as `2s`. set, faults: as of `stepbus.load`. observe, act: which numbers, `port` or
    `port.field`, in this order; default: all of all inputs, and what the outputs need that
    are read. joints: which joints are commanded; default: all. mode: how. limits:
    `port.field` → (lowest, highest), where no port describes them, or others. record: `none`,
    `all` (into `episodes/`), or a folder: each episode is a run there. policy: `module:function`,
    which recordings name as what they replay. vary: draws settings for each episode, as `set`.
    render_mode: `rgb_array`; camera: where from.

    Observations and actions are vectors in SI units (`observation_fields`, `action_fields`); an
    action beyond its limits is clipped. All other participants run in this process, without a
    deadline for the policy. Call `close` at the end.

    Raises ScenarioError or WiringError for what cannot run, RunFailure where the simulation fails.
    """

    metadata = _METADATA

    def __init__(
        self,
        scenario: AnyScenario,
        participant: str = "controller",
        *,
        reward: Callable[[Moment], float],
        terminated: Callable[[Moment], bool] | None = None,
        duration: str | None = None,
        set: Overrides = (),  # noqa: A002  as --set on the command line
        faults: Sequence[str] = (),
        observe: Sequence[str] = (),
        act: Sequence[str] = (),
        joints: Sequence[str] = (),
        mode: Mode = "torque",
        limits: Limits | None = None,
        record: str | PathLike[str] = "none",
        policy: str = "",
        vary: Callable[[np.random.Generator], Overrides] | None = None,
        render_mode: str | None = None,
        camera: Camera | None = None,
    ) -> None:
        for name, function in (("reward", reward), ("terminated", terminated), ("vary", vary)):
            if function is not None and not callable(function):
                raise WiringError(f"{name} is not a function, but {type(function).__name__}")
        if render_mode not in {None, "rgb_array"}:
            raise WiringError(f"render_mode {render_mode!r}: only 'rgb_array' is supported")
        self._place = os.getpid(), threading.get_ident()
        self._reward, self._terminated, self._vary = reward, terminated, vary
        self.render_mode = render_mode
        self._renderer = Renderer(camera or Camera())
        self._frame: Any = None
        self._folders = Folders(record)
        self._kept = contextlib.ExitStack()
        self._memory: Heartbeat | None = None
        self._episode: Episode | None = None
        self._participant: PolicyParticipant | None = None
        self._observation: Vector = np.zeros(0)
        self._inputs: Mapping[str, Any] = {}
        self.result: Result | None = None
        self._seeded, self._recording = False, ""
        self._given, self._faults, self._name = scenario, list(faults), participant
        self._settings = [*override_texts(set), *([f"duration={duration}"] if duration else [])]
        params = {
            "policy": policy,
            "observe": list(observe),
            "act": list(act),
            "joints": list(joints),
            "mode": mode,
            "limits": {name: _listed(pair) for name, pair in (limits or {}).items()},
        }
        self._params = {key: value for key, value in params.items() if value}
        self._scenario = self._load([])
        steps = self._scenario.steps
        self._steps = math.inf if steps is None else steps
        try:
            self._learn_spaces()
        except BaseException:
            self._kept.close()
            raise

    # --- Gymnasium ------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Start an episode; return its first observation, and its step and recording.

        seed: of the scenario, and of those drawn for the episodes after it. Without, the first
        episode has that of the scenario. options: `set`, settings for this episode.
        """
        self._end("reset")
        unknown = [key for key in options or {} if key != "set"]
        if unknown:
            raise WiringError(f"reset has no option {unknown[0]!r}; it has `set`")
        if seed is None and not self._seeded:
            seed = self._scenario.seed
        super().reset(seed=seed)
        self._seeded = True
        episode_seed = seed if seed is not None else int(self.np_random.integers(2**31))
        more = override_texts((options or {}).get("set", ()))
        if self._vary is not None:
            more = [*override_texts(self._vary(self.np_random)), *more]
        scenario = self._load(more) if more else self._scenario
        step = self._begin(dataclasses.replace(scenario, seed=episode_seed), self._folders)
        return self._observation, {"step": step.index, "t": step.t, "recording": self._recording}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Take an action; return observation, reward, whether terminated or truncated, and info.

        Raises RunError for an action of another form, or a reward that is none.
        """
        episode = self._episode
        if episode is None or episode.step is None:
            raise ResetNeeded("no episode is running: call reset first")
        given = checked_action(action, len(self.action_fields), episode.step.index)
        step = episode.advance(given)
        index, t, function = step.index, step.t, "reward"
        moment = Moment(
            step=index, t=t, observation=self._observation, action=given, inputs=self._inputs
        )
        try:
            value, function = self._reward(moment), "terminated"
            ends = self._terminated is not None and bool(self._terminated(moment))
        except Exception as exc:
            raise RunError(f"step {index}: `{function}` raised {error_text(exc)}") from exc
        reward = _number(value, index)
        is_late = index >= self._steps
        info = {"step": index, "t": t, "recording": self._recording}
        if ends or is_late:
            if self.render_mode is not None:
                self._frame = self._renderer.frame()
            self._end("terminated" if ends else "truncated")
        return moment.observation, reward, ends, is_late and not ends, info

    def render(self) -> Any:
        """Return a picture of the moment, shape (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            return None
        if self._episode is not None:
            return self._renderer.frame()
        if self._frame is None:
            raise ResetNeeded("there is nothing to render yet: call reset first")
        return self._frame

    def close(self) -> None:
        """End the episode; a recording of it stays."""
        try:
            self._end("closed")
        finally:
            self._folders.drop()
            self._kept.close()
            self._memory = None

    def __del__(self) -> None:
        is_ours = (os.getpid(), threading.get_ident()) == self.__dict__.get("_place")
        if is_ours and self.__dict__.get("_memory") is not None:
            with contextlib.suppress(Exception):
                self.close()

    # --- episodes -------------------------------------------------------------------------

    def twin(self) -> StepbusEnv:
        """Return another environment of the scenario that is loaded, before the first reset."""
        made = copy.copy(self)
        made._renderer, made._folders = copy.copy(self._renderer), copy.copy(self._folders)
        made._kept, made._memory = contextlib.ExitStack(), None
        return made

    def _load(self, more: Sequence[str]) -> Scenario:
        loaded = stepbus.load(self._given, set=[*self._settings, *more], faults=self._faults)
        return _with_policy(loaded, self._name, self._params)

    def _learn_spaces(self) -> None:
        """Run to the first observation, which says what all of them hold."""
        temporary = Folders("none")
        try:
            self._begin(self._scenario, temporary)
            made = self._participant
            interface = None if made is None else made.interface
            if interface is None:
                raise ResetNeeded("no episode has begun")
        except RunFailure as exc:
            # The logs are lost: their folder goes now.
            exc.args = (exc.cause,)
            raise
        finally:
            self._end("closed")
            temporary.drop()
        self.result = None
        self.observation_fields, self.action_fields = interface.observation, interface.action
        low, high = bounds(interface.observation)
        self.observation_space = Box(low, high, dtype=np.float64)
        ends = [(field.low, field.high) for field in interface.action]
        self.action_space = Box(*np.array(ends).reshape(-1, 2).T, dtype=np.float64)
        fields = {"observation": interface.observation, "action": interface.action}
        every = self._scenario.participant(self._name).every
        self.metadata = {
            **type(self).metadata,
            "render_fps": round(1e9 / (self._scenario.step_ns * every)),
            "units": {
                space: {field.name: field.unit for field in own} for space, own in fields.items()
            },
        }

    def _begin(self, scenario: Scenario, folders: Folders) -> Step:
        if self._memory is None:
            # To start the process that watches takes as long as all else.
            self._memory = self._kept.enter_context(watched_memory())
        with self._renderer.watching() if self.render_mode else contextlib.nullcontext():
            self._episode = episode = Episode(
                scenario,
                self._name,
                self._make,
                folders.make(),
                is_recorded=folders.is_recorded,
                memory=self._memory,
            )
            self._recording = str(episode.recording) if folders.is_recorded else ""
            try:
                return episode.start()
            except BaseException:
                self._episode = None
                raise

    def _make(self, config: Config, answer: Callable[[Step], Any]) -> PolicyParticipant:
        def act(observation: Vector, inputs: Mapping[str, Any], step: Step) -> Vector:
            self._observation, self._inputs = observation, inputs
            action: Vector = answer(step)
            return action

        self._participant = PolicyParticipant(config, act)
        return self._participant

    def _end(self, reason: str) -> None:
        episode, self._episode = self._episode, None
        try:
            if episode is not None and episode.step is not None:
                self.result = episode.end(f"the episode is {reason}")
        finally:
            if self._participant is not None:
                self._participant = episode = None
                collect_garbage()


def _with_policy(scenario: Scenario, name: str, params: Mapping[str, Any]) -> Scenario:
    """Return a scenario in which a policy has the place of a participant.

    Raises WiringError where that cannot be.
    """
    specs = {spec.name: spec for spec in scenario.participants}
    spec = specs.get(name)
    if spec is None:
        raise WiringError(
            f"{scenario.name} has no participant {name!r}{suggest(name, specs)}; "
            f"it has {', '.join(specs)}"
        )
    if spec.publishes == "first":
        raise WiringError(
            f"{name} publishes first, before it reads its inputs; a policy needs the inputs first"
        )
    ports = PolicyPorts(
        inputs={
            port: scenario.participant(row.source).outputs[row.port].type
            for port, row in spec.inputs.items()
        },
        outputs={port: row.type for port, row in spec.outputs.items()},
        types=scenario.types,
    )
    read = {(row.source, row.port) for other in specs.values() for row in other.inputs.values()}
    act = list(params.get("act", ())) or ports.default_action(
        [port for port in ports.outputs if (name, port) in read]
    )
    if not act:
        raise WiringError(
            f"{name} has no numeric output that another participant reads; set `act` to the "
            "outputs that the policy controls"
        )
    params = {**params, "act": act}
    ports.check(Params.of(params))
    changed = msgspec.structs.replace(
        spec,
        participant="stepbus_gym.policy:LoadedPolicy",
        exec=(),
        params=params,
        files=(),
        bridge=None,
        on_fault="stop",
        start="child",
    )
    rows = tuple(changed if row.name == name else row for row in scenario.participants)
    return dataclasses.replace(scenario, participants=rows)


def _listed(value: Any) -> Any:
    """Return a tuple or an array as a list of plain numbers."""
    return np.asarray(value).tolist() if isinstance(value, tuple | np.ndarray) else value


def _number(value: Any, step: int) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise RunError(f"step {step}: `reward` returned {value!r}, not a finite number")
    return number


DEFAULT = "episodes"


class Folders:
    """Makes a folder for each episode.

    record: `none`, `all`, or the folder to record to. Recordings are numbered from 1 on in that
    folder, by default `episodes`, whatever else records there; all others are temporary.
    """

    _temporary: TemporaryDirectory[str] | None = None

    def __init__(self, record: str | PathLike[str]) -> None:
        self.is_recorded = record != "none"
        self._parent = Path(DEFAULT if record == "all" else record).absolute()

    def make(self) -> Path:
        """Return a new folder; raises RecordingFailed where none can be made."""
        try:
            if not self.is_recorded:
                if self._temporary is None:
                    self._temporary = TemporaryDirectory(
                        prefix="gym-stepbus-", ignore_cleanup_errors=True
                    )
                folder = Path(self._temporary.name, "run")
                # All that a run writes which is not recorded.
                shutil.rmtree(folder / LOGS_FOLDER, ignore_errors=True)
                return folder
            self._parent.mkdir(parents=True, exist_ok=True)
            known = [int(path.name) for path in self._parent.iterdir() if path.name.isdigit()]
            numbers = itertools.count(max(known, default=0) + 1)
            return first_new(self._parent / f"{number:06}" for number in numbers)
        except OSError as exc:
            raise RecordingFailed(
                f"cannot create a folder for an episode: {exc.filename}: {exc.strerror or exc}"
            ) from exc

    def drop(self) -> None:
        """Remove what is temporary."""
        if self._temporary is not None:
            self._temporary.cleanup()
            self._temporary = None
