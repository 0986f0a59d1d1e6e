"""One instance of an FMU for co-simulation, FMI 2.0 or 3.0, over FMPy's calls of its functions."""

import shutil
import tempfile
import zlib
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from ctypes import byref
from functools import partial
from pathlib import Path
from typing import Any

from fmpy import calloc, extract, fmi2, fmi3, free
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from stepbus_participant import scratch_folder, warn
from stepbus_schemas import RunError, WiringError

from .model import Model, Variable, kind_of, names_of, open_fmu
from .params import Params

_STATUS = dict(enumerate(("ok", "warning", "discard", "error", "fatal", "pending")))
_DISCARD, _FATAL = 2, 4
_MOST_UPDATES = 1000
"""Updates of the discrete states at one time, after which they are taken not to end."""


class FmuError(RunError):
    """A call of an FMU has failed. The text has what the FMU logged last."""


class _Program:
    """The program of an FMU. FMPy demands all functions, also of other interfaces (FMPy#804)."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:
        def missing(*_: Any) -> None:
            raise FmuError(f"its program has no function {name}")

        return getattr(self._library, name, missing)


class _Partial:
    dll: Any

    def _loadFunctions(self) -> None:  # noqa: N802  (as FMPy calls it)
        self.dll = _Program(self.dll)
        super()._loadFunctions()  # type: ignore[misc]


# FMPy goes by the beginning of these names.
_Fmu2 = type("FMU2Partial", (_Partial, fmi2.FMU2Slave), {})
_Fmu3 = type("FMU3Partial", (_Partial, fmi3.FMU3Slave), {})


class Values:
    """Variables of one type that are read and written together, in a buffer made once.

    names: of the values, in their order.
    """

    def __init__(self, fmu: Any, variables: Sequence[Variable]) -> None:
        self._type, self.kind = variables[0].type, kind_of(variables[0])
        self.names = [name for item in variables for name in names_of(item)]
        is_2, function = isinstance(fmu, _Fmu2), self._type
        if function == "Enumeration":
            function = "Integer" if is_2 else "Int64"
        references = [item.valueReference for item in variables]
        count = () if is_2 else (len(self.names),)
        self._buffer: Any = None
        if self.kind in (str, bytes):
            self._get = partial(getattr(fmu, f"get{function}"), references, *count)
            self._set = partial(getattr(fmu, f"set{function}"), references)
            return
        # FMPy's own methods make new buffers at each call.
        module, prefix = (fmi2, "fmi2") if is_2 else (fmi3, "fmi3")
        self._buffer = (getattr(module, f"{prefix}{function}") * len(self.names))()
        handles = (getattr(module, f"{prefix}ValueReference") * len(references))(*references)
        arguments = (fmu.component, handles, len(references), self._buffer, *count)
        self._get = partial(_call, fmu, f"{prefix}Get{function}", *arguments)
        self._set = partial(_call, fmu, f"{prefix}Set{function}", *arguments)

    def get(self) -> list[Any]:
        """Return the values."""
        got = self._get()
        if self.kind is str:
            return [value.decode() if isinstance(value, bytes) else value for value in got]
        if self.kind is bytes:
            return [value or b"" for value in got]
        return self._buffer[:] if self.kind is not bool else list(map(bool, self._buffer))

    def set(self, values: list[Any]) -> None:
        """Write the values."""
        if self._buffer is None:
            self._set(values)
            return
        self._buffer[:] = values
        # ctypes cuts off what does not fit.
        if self.kind is int and self._buffer[:] != values:
            names = ", ".join(self.names[:5])
            raise FmuError(f"{names}: {values} does not fit the type {self._type}")
        self._set()


def _call(fmu: Any, name: str, *args: Any) -> None:
    status = fmu._functions[name](*args)
    if status > 1:
        raise FMICallException(name, status)


class Instance:
    """An FMU that is initialized. What it logs goes to standard output; errors quote the last.

    values: variable → list of start values. ended: whether it ends the run. Raises WiringError
    where it cannot be started, then FmuError.
    """

    def __init__(self, model: Model, params: Params, values: Mapping[str, Any]) -> None:
        self.model = model
        self.ended = False
        self._has_events = model.is_3 and params.event_mode and bool(model.can.hasEventMode)
        self._lines: deque[str] = deque(maxlen=3)
        self._is_off_grid = self._may_terminate = False
        self._may_free = True
        self._folder = Path(tempfile.mkdtemp(prefix="stepbus-fmu-", dir=scratch_folder()))
        self._fmu: Any = None
        try:
            self._instantiate(params)
            self._initialize(values, params.start_time, params.tolerance)
        except FmuError as exc:
            self.close()
            raise WiringError(f"{model.file} cannot be initialized: {exc}") from exc
        except BaseException:
            self.close()
            raise

    def _instantiate(self, params: Params) -> None:
        """Unpack the FMU, load its program, and make the instance."""
        more: dict[str, Any] = {"logMessage": self._log, "earlyReturnAllowed": True}
        more["eventModeUsed"] = self._has_events
        if not self.model.is_3:
            calls = fmi2.fmi2CallbackFunctions()
            calls.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
            calls.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
            calls.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
            addLoggerProxy(byref(calls))
            more = {"callbacks": calls}
        try:
            extract(open_fmu(params.fmu, params.inside), self._folder)
            fmu = (_Fmu3 if self.model.is_3 else _Fmu2)(
                guid=self.model.description.guid,
                modelIdentifier=self.model.can.modelIdentifier,
                unzipDirectory=str(self._folder),
            )
            fmu.instantiate(loggingOn=params.log, **more)
        except Exception as exc:
            text = str(exc).replace(str(self._folder), self.model.file).rstrip(".")
            if "Cannot find shared library" in text:
                files = (self._folder / "binaries").glob("*/*")
                there = sorted(f"{item.parent.name}/{item.name}" for item in files)
                text += f"; it has programs for {', '.join(there) or 'no platform'}"
            raise WiringError(self._explained(f"{self.model.file}: {text}")) from exc
        self._fmu = fmu

    def _initialize(self, values: Mapping[str, Any], time: float, tolerance: float | None) -> None:
        fmu, variables = self._fmu, self.model.variables
        sizes = [n for n in values if variables[n].causality == "structuralParameter"]
        if sizes:
            self.do(fmu.enterConfigurationMode)
            self._set_start(values, sizes)
            self.do(fmu.exitConfigurationMode)
        if not self.model.is_3:
            self.do(fmu.setupExperiment, tolerance, time, None)
        self._set_start(values, [name for name in values if name not in sizes])
        self.do(fmu.enterInitializationMode, *((tolerance, time, None) if self.model.is_3 else ()))
        self.do(fmu.exitInitializationMode)
        self._may_terminate = True
        if self._has_events:
            self._update_discrete_states()

    def _set_start(self, values: Mapping[str, Any], chosen: Iterable[str]) -> None:
        for name in chosen:
            (group,) = self.values([self.model.variables[name]])
            self.do(group.set, values[name])

    def values(self, variables: Iterable[Variable]) -> list[Values]:
        """Return access to variables, for each type."""
        by_type: dict[str, list[Variable]] = {}
        for item in variables:
            by_type.setdefault(item.type, []).append(item)
        return [Values(self._fmu, items) for items in by_type.values()]

    def get(self, groups: Sequence[Values]) -> dict[str, Any]:
        """Return name → value."""
        return {
            name: value
            for group in groups
            for name, value in zip(group.names, self.do(group.get), strict=True)
        }

    def set(self, groups: Sequence[Values], values: Mapping[str, Any]) -> None:
        """Set variables by name → value."""
        for group in groups:
            self.do(group.set, [values[name] for name in group.names])

    def set_in_event(self, groups: Sequence[Values], values: Mapping[str, Any]) -> None:
        """Set what may change in events only: discrete inputs, tunable parameters."""
        if self._has_events:
            self.do(self._fmu.enterEventMode)
        self.set(groups, values)
        if self._has_events:
            self._update_discrete_states()

    def set_slopes(self, references: Sequence[int], slopes: Sequence[float]) -> None:
        """Set the derivatives of real inputs, from now on [1/s]."""
        self.do(self._fmu.setRealInputDerivatives, references, [1] * len(references), slopes)

    def step(self, time: float, h: float) -> None:
        """Do a step of length h [s] at a time; `ended` tells whether the FMU ends the run."""
        if self.model.is_3:
            self._step_3(time, h)
            return
        fmu = self._fmu
        try:
            _call(fmu, "fmi2DoStep", fmu.component, time, h, fmi2.fmi2True)
        except FMICallException as exc:
            error = self._error(exc)
            if exc.status == _DISCARD:
                with suppress(FMICallException):
                    self.ended = bool(fmu.getBooleanStatus(fmi2.fmi2Terminated))
            if not self.ended:
                raise error from exc

    def _step_3(self, time: float, h: float) -> None:
        until = time + h
        while not self.ended:
            needs_event, self.ended, early, reached = self.do(self._fmu.doStep, time, h)
            if needs_event and self._has_events and not self.ended:
                self.do(self._fmu.enterEventMode)
                self._update_discrete_states()
            if self.ended or abs(reached - until) <= 1e-9 * max(1.0, abs(until)):
                return
            if not early:
                self._check_grid(reached, until)
                return
            if not time <= reached < until:
                raise FmuError(f"from {time!r} s, it returned early at {reached!r} s")
            time, h = reached, until - reached

    def _check_grid(self, reached: float, until: float) -> None:
        """Accept the end of a step that is on the grid of the FMU's own steps; warn once."""
        fixed = self.model.internal_step
        text = f"it stopped at {reached!r} s, not at {until!r} s"
        if abs(reached - until) > fixed * (1 + 1e-9):
            raise FmuError(text)
        if not self._is_off_grid:
            warn(f"{self.model.file} keeps to its own steps of {fixed:g} s: {text}")
        self._is_off_grid = True

    def _update_discrete_states(self) -> None:
        for _ in range(_MOST_UPDATES):
            again, self.ended, *_ = self.do(self._fmu.updateDiscreteStates)
            if not again or self.ended:
                break
        else:
            raise FmuError(f"its discrete states change without end ({_MOST_UPDATES} times)")
        if not self.ended:
            self.do(self._fmu.enterStepMode)

    def save(self) -> bytes:
        """Return its state, packed: those of Dymola are a megabyte of zeros."""
        state = self.do(self._fmu.getFMUState)
        try:
            return zlib.compress(self.do(self._fmu.serializeFMUState, state), 1)
        finally:
            self.do(self._fmu.freeFMUState, state)

    def restore(self, saved: bytes) -> None:
        """Take a state that `save` returned."""
        fmu = self._fmu
        take = fmu.deserializeFMUState if self.model.is_3 else fmu.deSerializeFMUstate
        state = self.do(take, zlib.decompress(saved))
        try:
            self.do(fmu.setFMUState, state)
        finally:
            self.do(fmu.freeFMUState, state)

    def close(self) -> None:
        """End the instance, and remove what was unpacked."""
        try:
            if self._may_terminate:
                self.do(self._fmu.terminate)
        except FmuError as exc:
            print(f"at its end: {exc}")  # noqa: T201  (to its log)
        finally:
            if self._fmu is not None and self._may_free:
                self._fmu.freeInstance()
            self._fmu, self._may_terminate = None, False
            shutil.rmtree(self._folder, ignore_errors=True)

    def do(self, call: Any, *args: Any) -> Any:
        """Return what a call returns; raises FmuError that has what the FMU logged last."""
        try:
            return call(*args)
        except FMICallException as exc:
            raise self._error(exc) from exc

    def _error(self, exc: FMICallException) -> FmuError:
        # After an error, an FMU may only be freed; after a fatal one, not even that.
        self._may_terminate &= exc.status == _DISCARD
        self._may_free &= exc.status != _FATAL
        name = _STATUS.get(exc.status, exc.status)
        return FmuError(self._explained(f"{exc.function} returned {name}"))

    def _explained(self, text: str) -> str:
        """Return a text, with what the FMU logged last."""
        return f"{text}: {'; '.join(self._lines)}" if self._lines else text

    def _log(self, *said: Any) -> None:
        # FMI 2 says the name of the instance, too.
        status, category, text = said[-3:]
        of, line = ((part or b"").decode(errors="replace").strip() for part in (category, text))
        print(f"[{_STATUS.get(status, status)}] {of}: {line}", flush=True)  # noqa: T201
        if status > 0:
            self._lines.append(line)
