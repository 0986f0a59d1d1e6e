"""What determines a run's result, as text, so that it can be run again from that."""

import io
import re
import sys
from functools import lru_cache
from typing import Any

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import SafeRepresenter

from stepbus_participant import format_duration
from stepbus_participant.parameters import remember

from .fault_texts import format_fault
from .model import BridgeSpec, HoldSpec, ParticipantSpec, Scenario
from .ports import InputSpec, OutputSpec

_HARMLESS = re.compile(r"(?:--?|\.{0,2}/)?[A-Za-z0-9_][A-Za-z0-9_./+-]*")


class _Representer(SafeRepresenter):
    """Writes every value where it stands, and so that it is read back as it was."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return that a list or map that stands in two places is written twice."""
        return True

    def represent_text(self, text: str) -> ScalarNode:
        """Return text, in quotes unless it is harmless."""
        # ruamel.yaml 0.19 leaves bare, or in single quotes, texts that it does not read back as
        # they were: '?0', and line breaks such as U+0085.
        style = None if _HARMLESS.fullmatch(text) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Representer.add_representer(str, _Representer.represent_text)


def resolved(scenario: Scenario) -> str:
    """Return the canonical YAML of what determines a scenario's result.

    Bus, window, batch, checkpoints and deadlines are left out: they change no result. Loading the
    text beside the same files gives an equal scenario but for these, and the same text again.
    """
    content = _scenario(scenario)
    rows = content.pop("participants")
    # Each by itself: of the runs of a sweep, most are those of the run before.
    text = _yaml({**content, "participants": [{}]}).removesuffix("- {}\n")
    for name, row in rows.items():
        text += "  " + _yaml({name: row})[:-1].replace("\n", "\n  ") + "\n"
    remember(text, {**content, "participants": rows})
    return text


def _yaml(content: dict[str, Any]) -> str:
    return _as_yaml(msgspec.msgpack.encode(content))


@lru_cache(maxsize=256)
def _as_yaml(content: bytes) -> str:
    """Return a map as YAML; content: in MessagePack."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.default_flow_style = None
    yaml.width = sys.maxsize
    # The order of maps is part of a scenario: participants that could go first go in that order.
    yaml.representer.sort_base_mapping_type_on_output = False
    stream = io.StringIO()
    yaml.dump(msgspec.msgpack.decode(content), stream)
    return stream.getvalue()


def _scenario(scenario: Scenario) -> dict[str, Any]:
    content: dict[str, Any] = {"name": scenario.name, "step": format_duration(scenario.step_ns)}
    if scenario.steps is not None:
        content["duration"] = format_duration(scenario.steps * scenario.step_ns)
    content["seed"] = scenario.seed
    if scenario.types.declarations or scenario.type_files:
        content["types"] = _types(scenario)
    if scenario.faults:
        content["faults"] = [format_fault(fault) for fault in scenario.faults]
    content["participants"] = {spec.name: _participant(spec) for spec in scenario.participants}
    return content


def _types(scenario: Scenario) -> Any:
    """Return the files that declare types, and in full those that come from anywhere else."""
    in_files = {name for names in scenario.type_files.values() for name in names}
    others = {
        name: dict(row) for name, row in scenario.types.declarations.items() if name not in in_files
    }
    parts = [*scenario.type_files, *([others] if others else [])]
    return parts[0] if len(parts) == 1 else parts


def _participant(spec: ParticipantSpec) -> dict[str, Any]:
    content: dict[str, Any] = {
        "participant": spec.participant,
        "exec": list(spec.exec),
        "files": list(spec.files),
        "bridge": spec.bridge and _keys(spec.bridge),
        "every": spec.every,
        "publishes": spec.publishes,
        "inputs": {name: _keys(item) for name, item in spec.inputs.items()},
        "outputs": {name: _keys(item) for name, item in spec.outputs.items()},
        "params": dict(spec.params),
        "on_fault": spec.hold and _on_fault(spec.hold),
    }
    return {key: value for key, value in content.items() if value not in (None, {}, [], "")}


def _on_fault(hold: HoldSpec) -> dict[str, Any]:
    times = {"hold": format_duration(hold.hold_ns), "keep": format_duration(hold.keep_ns)}
    return {**times, "safe": hold.safe} if hold.safe else times


def _keys(settings: InputSpec | OutputSpec | BridgeSpec) -> Any:
    """Return the keys that are no defaults; the short form where that says it all."""
    keys = msgspec.to_builtins(settings)
    return keys[settings.short] if set(keys) == {settings.short} else keys
