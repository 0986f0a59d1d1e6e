"""The FMU at work: what pythonfmu and pythonfmu3 call, for both versions of FMI."""

import contextlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar
from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element, SubElement

import msgspec

from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import Message, RunError, StepbusError, error_text

from .interface import PARAMS, Interface, Row
from .play import All, Messages, One

FILE = "interface.json"
_TYPES_3 = {"Real": "Float64", "Integer": "Int64"}
_INT32 = 2**31
KEPT: list[Any] = []
"""The modules of FMUs: pythonfmu 0.7 executes them for each instance, and releases what it does not
own; the second instance found an empty module."""


class Exported:
    """What an FMU adds to the slave of a library; `library` is its module."""

    library: ClassVar[Any]
    # Those of the slave.
    resources: str
    log: Callable[..., None]
    register_variable: Callable[..., None]

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        content = Path(self.resources, FILE).read_bytes()
        self._interface = own = msgspec.json.decode(content, type=Interface)
        self._is_3 = self.library.__name__ == "pythonfmu3"
        self._values = [value for row in own.rows for value in row.start]
        self._started, self._next = list(self._values), 0
        self._player: One | All | None = None
        self._makers: Mapping[str, type[Message]] = {}
        # The same scenario makes the same FMU.
        self.guid, self.description = uuid5(NAMESPACE_URL, content.decode()), own.text
        self.default_experiment = self.library.DefaultExperiment(
            start_time=0.0, stop_time=own.duration_s, step_size=own.step_ns * 1e-9
        )
        self._places: list[tuple[Row, slice]] = []
        for row in own.rows:
            first = sum(len(one.start) for one, _ in self._places)
            self._places.append((row, slice(first, first + len(row.start))))
            for index, (name, text) in enumerate(row.variables(), first):
                kind = _TYPES_3.get(row.kind, row.kind) if self._is_3 else row.kind
                varies = "fixed" if row.causality == "parameter" else "discrete"
                varies = "continuous" if row.kind == "Real" and varies != "fixed" else varies
                self._register(kind, name, index, row.causality, varies, description=text)
        if self._is_3:
            self._values.append(0.0)
            self._register("Float64", "time", -1, "independent", "continuous", description="[s]")

    def _register(
        self, kind: str, name: str, index: int, causality: str, varies: str, **given: str
    ) -> None:
        variable = getattr(self.library, kind)(
            name,
            causality=self._enum("Causality")[causality],
            variability=self._enum("Variability")[varies],
            getter=lambda: self._values[index],
            setter=lambda value: self._values.__setitem__(index, value),
            **given,
        )
        self.register_variable(variable, nested=False)

    def _open(self) -> None:
        """Start what is in the FMU; its errors pass through."""
        own, name = self._interface, self._interface.participant or self._interface.played
        changed = [
            f"{row.owner}.{PARAMS}.{row.field}={json.dumps(self._values[place.start])}"
            for row, place in self._places
            if row.causality == "parameter" and self._values[place] != self._started[place]
        ]
        scenario = load(Path(self.resources, own.scenario), changed)
        if own.participant:
            self._player = One(scenario, name, own.described)
        else:
            outputs = [row for row in own.rows if row.causality == "output"]
            seen = {(row.owner, row.port) for row in outputs}
            self._player = All(scenario, name, own.described, seen)
        spec = scenario.participant(name) if name else None
        types = {
            port: scenario.participant(row.source).outputs[row.port].type
            for port, row in (spec.inputs.items() if spec and own.participant else ())
        } or {port: row.type for port, row in (spec.outputs.items() if spec else ())}
        self._makers = {port: scenario.types[type_] for port, type_ in types.items()}
        self._show()

    def _messages(self) -> Messages:
        """Return the inputs of the FMU as messages."""
        fields = dict[tuple[str, str], dict[str, Any]]()
        for row, place in self._places:
            if row.causality == "input":
                value = row.nested(self._values[place])
                fields.setdefault((row.owner, row.port), {})[row.field] = value
        return {key: self._makers[key[1]](**values) for key, values in fields.items()}

    def _show(self) -> None:
        """Take the values of the outputs; those of a port that has none yet stay."""
        outputs = self._player.outputs if self._player else {}
        for row, place in self._places:
            message = outputs.get((row.owner, row.port)) if row.causality == "output" else None
            if message is not None:
                values = row.flat(getattr(message, row.field))
                if row.kind == "Integer" and not self._is_3 and max(map(abs, values)) >= _INT32:
                    raise RunError(f"{row.owner}.{row.port}.{row.field} is beyond FMI 2's 32 bits")
                self._values[place] = values

    def _end(self, text: str, *, is_error: bool) -> Any:
        """Say why no step is made, and return what stands for that."""
        status = self._enum("Status")["error" if is_error else "ok"]
        self.log(text, status)
        if not self._is_3:
            return False
        return self.library.Fmi3StepResult(status=status, terminateSimulation=not is_error)

    def _enum(self, name: str) -> Any:
        return getattr(self.library.enums, f"Fmi{3 if self._is_3 else 2}{name}")

    # --- what the libraries call --------------------------------------------------------------

    def to_xml(self, *given: Any) -> Element:
        """Return the model description, with what the libraries leave out."""
        root: Element = super().to_xml(*given)  # type: ignore[misc]
        units, variables = dict[str, None](), root.find("ModelVariables")
        rows = [row for row in self._interface.rows for _ in row.start]
        for index, (row, node) in enumerate(zip(rows, variables or (), strict=False)):
            typed = node if self._is_3 else node[0]
            if row.kind == "Real" and row.causality != "output":
                typed.set("start", repr(self._values[index]))
            if row.unit:
                units[row.unit] = None
                typed.set("unit", row.unit)
        outputs = root.find("ModelStructure/Outputs")
        if outputs is not None:
            root[-1].append(Element("InitialUnknowns"))
            root[-1][-1].extend(outputs)
        if units:
            root.insert(1, Element("UnitDefinitions"))
            for unit in units:
                SubElement(root[1], "Unit", name=unit)
        return root

    def exit_initialization_mode(self) -> None:
        """Start what is in the FMU, with the parameters that the importer has set."""
        try:
            self._open()
        except StepbusError as exc:
            raise RunError(str(exc)) from exc

    def do_step(self, current_time: float, step_size: float) -> Any:
        """Work on the step at a time [s]; anything but the scenario's step is an error."""
        step_s = self._interface.step_ns * 1e-9
        index = round(current_time / step_s)
        is_on_grid = math.isclose(current_time, index * step_s, abs_tol=1e-3 * step_s)
        if not math.isclose(step_size, step_s, rel_tol=1e-6) or not is_on_grid:
            text = f"the FMU takes steps of {step_s:g} s from 0 on"
            return self._end(f"{text}, not {step_size:g} s at {current_time:g} s", is_error=True)
        if index != self._next or self._player is None:
            text = f"the next step of the FMU is {self._next}, not {index}"
            return self._end(f"{text}, at {current_time:g} s", is_error=True)
        try:
            reason = self._player.step(index, self._messages())
            self._next += 1
            if self._is_3:
                self._values[-1] = current_time + step_size
            self._show()
        except Exception as exc:
            said = str(exc) if isinstance(exc, StepbusError) else error_text(exc)
            text = f"step {index}: {said}"
            if self._is_3:
                return self._end(text, is_error=True)
            # The other way out is `discard`, after which an importer may go on.
            raise RunError(text) from exc
        return True if reason is None else self._end(f"step {index}: {reason}", is_error=False)

    def _get_fmu_state(self) -> dict[str, Any]:
        if not isinstance(self._player, One):
            raise RunError("the FMU has no state: it has not started, or is a whole scenario")
        saved, held = self._player.save()
        return {"next": self._next, "values": list(self._values), "saved": saved, "held": held}

    def _set_fmu_state(self, state: Mapping[str, Any]) -> None:
        """Go on from a state, by a participant that is new, as `restore` expects it."""
        self.terminate()
        self._values[:] = state["values"]
        self._open()
        if isinstance(self._player, One):
            self._player.restore(state["saved"], state["held"])
        self._next, self._values[:] = state["next"], state["values"]

    @staticmethod
    def _fmu_state_to_bytes(state: Mapping[str, Any]) -> bytes:
        return msgspec.msgpack.encode(state)

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> Any:
        return msgspec.msgpack.decode(state)

    def terminate(self) -> None:
        """End what is in the FMU."""
        self.__del__()

    def __del__(self) -> None:
        player, self._player = self.__dict__.get("_player"), None
        if player is not None:
            with contextlib.suppress(Exception):
                player.close()
