"""The ports of one participant, found by their message types."""

from collections.abc import Mapping

from stepbus_schemas import InputConfig, OutputConfig

from .config import Config


class Ports:
    """Finds ports by message type, where the scenario is free to name them.

    problems: what does not fit is added there, and an empty name returned; give them to
    `Config.read`, which refuses with all that is wrong.
    """

    def __init__(self, config: Config) -> None:
        self.problems = config.problems()
        self._config = config

    def input_of(self, type_name: str) -> str:
        """Return the one input of a message type."""
        return self._port("inputs", self._config.inputs, type_name)

    def output_of(self, type_name: str) -> str:
        """Return the one output of a message type."""
        return self._port("outputs", self._config.outputs, type_name)

    def optional_input_of(self, type_name: str) -> str | None:
        """Return the one input of a message type, or None where the scenario has none."""
        has_one = any(port.type == type_name for port in self._config.inputs.values())
        return self.input_of(type_name) if has_one else None

    def optional_output_of(self, type_name: str) -> str | None:
        """Return the one output of a message type, or None where the scenario has none."""
        has_one = any(port.type == type_name for port in self._config.outputs.values())
        return self.output_of(type_name) if has_one else None

    def input_beside(self, type_name: str, name: str) -> tuple[str, str]:
        """Return the input of a message type, and the other one of that type, which has a name.

        They are the same unless there are two, one of them called `name`.
        """
        names = [port for port, row in self._config.inputs.items() if row.type == type_name]
        if name in names and len(names) == 2:
            return next(port for port in names if port != name), name
        only = self.input_of(type_name)
        return only, only

    def event_outputs(self) -> tuple[str, str]:
        """Return the output of Event/1 for what happens, and that for the summary.

        They are the same unless there are two, one of them called `summary`.
        """
        names = [name for name, port in self._config.outputs.items() if port.type == "Event/1"]
        if "summary" in names and len(names) == 2:
            return next(name for name in names if name != "summary"), "summary"
        only = self.output_of("Event/1")
        return only, only

    def outputs_are(self, *types: str) -> None:
        """Refuse every output that is of none of these message types."""
        for name, port in self._config.outputs.items():
            if port.type not in types:
                text = f"nothing of type {port.type} is published; known: {', '.join(types)}"
                self.problems.add(("outputs", name), text)

    def _port(
        self, side: str, ports: Mapping[str, InputConfig] | Mapping[str, OutputConfig], wanted: str
    ) -> str:
        found = [name for name, port in ports.items() if port.type == wanted]
        if len(found) != 1:
            several = f"{', '.join(found)} are all of type {wanted}; leave one of them"
            none = f"none is of type {wanted}; add one"
            self.problems.add((side,), several if found else none)
        return found[0] if found else ""
