"""The FMU at work: what pythonfmu and pythonfmu3 call, for both versions of FMI."""

import json
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar
from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element, SubElement

import msgspec
import numpy as np

from stepbus_orchestrator.errors import RunFailure, ScenarioError
from stepbus_orchestrator.run.episode import Episode
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Config, Participant, Step
from stepbus_schemas import Message, RunError

from .interface import PARAMS, Interface, Played, Row

FILE = "interface.json"
_TYPES_3 = {"Real": "Float64", "Integer": "Int64", "Boolean": "Boolean", "String": "String"}
KEPT: list[Any] = []
"""The modules of FMUs: pythonfmu 0.7 executes them for each instance, and releases what it does not
own; the second instance found an empty module."""


class Importer(Participant):
    """The participant in whose place the importer is; it waits for the next `doStep`."""

    def __init__(self, config: Config, answer: Any, played: Mapping[str, Played]) -> None:
        super().__init__(config)
        described = {port: row.description for port, row in played.items()}
        self.update, self.describe = answer, lambda: described  # type: ignore[method-assign]


class Exported:
    """What an FMU adds to the slave of a library; `library` is its module."""

    library: ClassVar[Any]
    # Those of the slave.
    resources: str
    log: Callable[..., None]
    register_variable: Callable[..., None]
    _episode: Episode | None = None

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        content = Path(self.resources, FILE).read_bytes()
        self._interface = own = msgspec.json.decode(content, type=Interface)
        self._is_3 = self.library.__name__ == "pythonfmu3"
        self._values, self._next = list[Any](), 0
        # The same scenario makes the same FMU.
        self.guid, self.description = uuid5(NAMESPACE_URL, content.decode()), own.text
        self.default_experiment = self.library.DefaultExperiment(
            start_time=0.0, stop_time=own.duration_s, step_size=own.step_ns * 1e-9
        )
        self._places: list[tuple[Row, slice]] = []
        for row in own.rows:
            first = len(self._values)
            self._values += row.start
            self._places.append((row, slice(first, len(self._values))))
            make = getattr(self.library, _TYPES_3[row.kind] if self._is_3 else row.kind)
            is_fixed, is_real = row.causality == "parameter", row.kind == "Real"
            varies = "fixed" if is_fixed else "continuous" if is_real else "discrete"
            for index, (name, text) in enumerate(row.variables, first):
                variable = make(
                    name,
                    description=text,
                    causality=self._enum("Causality")[row.causality],
                    variability=self._enum("Variability")[varies],
                    getter=partial(self._values.__getitem__, index),
                    setter=partial(self._values.__setitem__, index),
                )
                self.register_variable(variable, nested=False)

    def _enum(self, name: str) -> Any:
        return getattr(self.library.enums, f"Fmi{3 if self._is_3 else 2}{name}")

    def _messages(self, index: int) -> Mapping[str, Message]:
        """Return what the importer publishes at a step, by port."""
        fields = dict[str, dict[str, Any]]()
        for row, place in self._places:
            if row.causality == "input" and self._interface.played[row.port].is_due(index):
                value = np.array(self._values[place], dtype=object).reshape(row.shape).tolist()
                fields.setdefault(row.port, {})[row.field] = value
        return {port: self._makers[port](**values) for port, values in fields.items()}

    def _show(self, step: Step) -> None:
        """Take the values of the outputs; those of a port that has none yet stay."""
        messages = {key: step.get(port) for port, key in self._seen.items()}
        for row, place in self._places:
            message = messages.get((row.owner, row.port)) if row.causality == "output" else None
            if message is not None:
                self._values[place] = values = row.flat(getattr(message, row.field))
                if row.kind == "Integer" and not self._is_3 and max(map(abs, values)) >= 2**31:
                    raise RunError(f"{row.owner}.{row.port}.{row.field} is beyond FMI 2's 32 bits")

    # --- what the libraries call --------------------------------------------------------------

    def to_xml(self, *given: Any) -> Element:
        """Return the model description, with what the libraries leave out; without the time."""
        root: Element = super().to_xml(*given)  # type: ignore[misc]
        del root.attrib["generationDateAndTime"]
        variables, definitions = root.find("ModelVariables"), Element("UnitDefinitions")
        rows = [row for row in self._interface.rows for _ in row.start]
        for row, node, start in zip(rows, variables or (), self._values, strict=False):
            typed = node if self._is_3 else node[0]
            if row.kind == "Real" and row.causality in {"input", "parameter"}:
                typed.set("start", repr(start) if math.isfinite(start) else "0.0")
            if row.unit:
                typed.set("unit", row.unit)
        outputs = root.find("ModelStructure/Outputs")
        if outputs is not None:
            SubElement(root[-1], "InitialUnknowns").extend(outputs)
        for unit in dict.fromkeys(row.unit for row in rows if row.unit):
            SubElement(definitions, "Unit", name=unit)
        if len(definitions):
            root.insert(1, definitions)
        return root

    def exit_initialization_mode(self) -> None:
        """Start what is in the FMU, with the parameters that the importer has set."""
        own = self._interface
        changed = [
            f"{row.owner}.{PARAMS}.{row.field}={json.dumps(self._values[place][0])}"
            for row, place in self._places
            if row.causality == "parameter" and self._values[place] != list(row.start)
        ]
        try:
            # In a window of one step, a participant that ends the run ends it with that step.
            scenario = load(Path(self.resources, own.scenario), ["window=1", *changed])
        except ScenarioError as exc:
            raise RunError(str(exc)) from exc
        spec = scenario.participant(own.importer)
        self._seen = {port: (item.source, item.port) for port, item in spec.inputs.items()}
        self._makers = {port: scenario.types[row.type] for port, row in spec.outputs.items()}
        self._folder = TemporaryDirectory(prefix="fmu-stepbus-", ignore_cleanup_errors=True)
        out, make = Path(self._folder.name, "run"), partial(Importer, played=own.played)
        self._episode = Episode(scenario, own.importer, make, out, is_recorded=False)
        self._show(self._episode.start())

    def do_step(self, current_time: float, step_size: float) -> Any:
        """Work on the step at a time [s]; raises RunError for any but the scenario's next one."""
        index, step_s = self._next, self._interface.step_ns * 1e-9
        is_next = math.isclose(current_time, index * step_s, abs_tol=1e-3 * step_s)
        if not math.isclose(step_size, step_s, rel_tol=1e-6) or not is_next or not self._episode:
            text = f"the next step of the FMU is of {step_s:g} s at {index * step_s:g} s"
            raise RunError(f"{text}, not {step_size:g} s at {current_time:g} s")
        try:
            self._show(self._episode.advance(self._messages(index)))
        except RunFailure:
            # It raises again, unless a participant has asked for the end.
            self.log(f"step {index}: {self._episode.end('').reason}")
            return self._is_3 and self.library.Fmi3StepResult(terminateSimulation=True)
        self._next += 1
        if self._is_3:
            self._values[-1] = current_time + step_size
        return True

    def terminate(self) -> None:
        """End what is in the FMU."""
        if self._episode is not None:
            self._episode.abandon()
            self._folder.cleanup()

    __del__ = terminate
