"""The models that a recording names: bodies of the plant's world, or the robot of a parameter."""

from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from stepbus_participant import find_file, read_text
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.scene.pose import Pose, Vector, from_rpy
from stepbus_tools.viewing.scene.scene import Body

from .model import Model, load_model

_MODELS = (".urdf", ".xacro", ".xml")


class Origin:
    """What a scenario and its files say of the scene.

    scenario: that has been unpacked with its files; None: nothing is known. It reads the `bodies`
    and `stock.types` of a world file, wherever a parameter names one; without, the models that
    parameters name. bodies: those with a place of their own. types: item type → its
    model. notes: what cannot be shown, a sentence each.
    """

    def __init__(self, scenario: Path | None = None) -> None:
        self.bodies: list[Body] = []
        self.types: dict[str, Model] = {}
        self.notes: list[str] = []
        if scenario is None:
            return
        specs = _map(self._yaml(scenario).get("participants")).values()
        params = dict.fromkeys(chain.from_iterable(_texts(_map(s).get("params")) for s in specs))
        for text in params:
            if text.endswith((".yaml", ".yml")):
                self._add_world(scenario.parent, text)
        for text in () if self.bodies else params:
            if text.endswith(_MODELS) and (model := self._model(text, scenario.parent)):
                self.bodies.append(Body(name=Path(text).name.split(".")[0], model=model))

    def _yaml(self, path: Path) -> Mapping[str, Any]:
        try:
            return _map(parse_yaml(path.name, read_text(path)))
        except (StepbusError, OSError, UnicodeDecodeError) as exc:
            self.notes.append(f"{path.name} cannot be read: {exc}")
            return {}

    def _add_world(self, folder: Path, name: str) -> None:
        try:
            path = find_file(name, folder)
        except StepbusError:
            return
        world = self._yaml(path)
        for body, given in _with_models(world.get("bodies")):
            joints = _map(given.get("joints")).items()
            starts = {joint: _map(row).get("position") for joint, row in joints}
            rest = {joint: float(x) for joint, x in starts.items() if isinstance(x, int | float)}
            if model := self._model(given["urdf"], path.parent, rest):
                turned = from_rpy(_vector(given.get("orientation_rpy")))
                start = Pose(_vector(given.get("position")), turned)
                is_fixed = given.get("fixed_base") is True
                self.bodies.append(Body(name=body, model=model, start=start, is_fixed=is_fixed))
        for kind, given in _with_models(_map(world.get("stock")).get("types")):
            if model := self._model(given["urdf"], path.parent):
                self.types[kind] = model

    def _model(self, name: str, folder: Path, rest: Mapping[str, float] = {}) -> Model | None:
        """Return a model. rest: where its joints start."""
        try:
            model = load_model(find_file(name, folder), rest)
        except StepbusError as exc:
            self.notes.append(f"{name} is not shown: {str(exc).splitlines()[0]}")
            return None
        self.notes.extend(note for note in model.notes if note not in self.notes)
        return model


def _map(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _with_models(rows: object) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for name, given in _map(rows).items():
        if isinstance(_map(given).get("urdf"), str):
            yield name, given


def _texts(value: object) -> Iterator[str]:
    """Yield every text in parameters."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _vector(value: object) -> Vector:
    if isinstance(value, list) and len(value) == 3:
        x, y, z = (float(v) if isinstance(v, int | float) else 0.0 for v in value)
        return (x, y, z)
    return (0.0, 0.0, 0.0)
