"""The models that a recording names: bodies of the plant's world, or the robot of a parameter."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepbus_orchestrator.recording import layout
from stepbus_participant import find_file, read_text
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.scene.primitives import Pose, from_rpy

from .model import Model, load_model

_MODELS = (".urdf", ".xacro", ".sdf")


@dataclass(frozen=True, kw_only=True)
class Body:
    """A body of a world.

    name: as in descriptions of poses. pose: of its root at the start. is_fixed: it stays there.
    """

    name: str
    model: Model
    pose: Pose = field(default_factory=Pose)
    is_fixed: bool = False


@dataclass(kw_only=True)
class Origin:
    """What a scenario and its files say of the scene.

    bodies: those with a place of their own. types: item type → its model. notes: what cannot be
    shown, a sentence each.
    """

    bodies: list[Body] = field(default_factory=list)
    types: dict[str, Model] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_origin(scenario: Path) -> Origin:
    """Return the bodies of a scenario that has been unpacked with its files.

    It reads the `bodies` and `stock` of a world file as the plant does, wherever a parameter names
    one; without, the models that parameters name.
    """
    origin = Origin()
    params = list(dict.fromkeys(_params(scenario, origin)))
    for text in params:
        if text.endswith((".yaml", ".yml")):
            _add_world(origin, scenario.parent, text)
    if not origin.bodies:
        for text in params:
            if text.endswith(_MODELS):
                model = _model(origin, text, scenario.parent, {})
                if model is not None:
                    origin.bodies.append(Body(name=Path(text).name.split(".")[0], model=model))
    return origin


def _params(scenario: Path, origin: Origin) -> Iterator[str]:
    """Yield every text in the parameters of all participants."""
    data = _yaml(origin, scenario)
    participants = data.get("participants")
    for spec in participants.values() if isinstance(participants, dict) else ():
        yield from _texts(spec.get("params") if isinstance(spec, dict) else None)


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item)


def _yaml(origin: Origin, path: Path) -> Mapping[str, Any]:
    try:
        data = parse_yaml(path.name, read_text(path))
    except (StepbusError, OSError, UnicodeDecodeError) as exc:
        origin.notes.append(f"{path.name} cannot be read: {exc}")
        return {}
    return data if isinstance(data, dict) else {}


def _add_world(origin: Origin, folder: Path, name: str) -> None:
    try:
        path = find_file(name, folder)
    except StepbusError:
        return
    data = _yaml(origin, path)
    bodies, stock = data.get("bodies"), data.get("stock")
    for body, given in bodies.items() if isinstance(bodies, dict) else ():
        if isinstance(given, dict) and isinstance(given.get("urdf"), str):
            model = _model(origin, given["urdf"], path.parent, _rest(given))
            if model is not None:
                is_fixed = given.get("fixed_base") is True
                made = Body(name=body, model=model, pose=_pose(given), is_fixed=is_fixed)
                origin.bodies.append(made)
    types = stock.get("types") if isinstance(stock, dict) else None
    for kind, given in types.items() if isinstance(types, dict) else ():
        if isinstance(given, dict) and isinstance(given.get("urdf"), str):
            model = _model(origin, given["urdf"], path.parent, {})
            if model is not None:
                origin.types[kind] = model


def _model(origin: Origin, name: str, folder: Path, rest: Mapping[str, float]) -> Model | None:
    try:
        model = load_model(find_file(name, folder), rest)
    except StepbusError as exc:
        origin.notes.append(f"{name} is not shown: {str(exc).splitlines()[0]}")
        return None
    origin.notes.extend(note for note in model.notes if note not in origin.notes)
    return model


def _rest(body: Mapping[str, Any]) -> dict[str, float]:
    """Return where the joints of a body start, as its world file says."""
    joints = body.get("joints")
    rows = joints.items() if isinstance(joints, dict) else ()
    positions = {name: given.get("position") for name, given in rows if isinstance(given, dict)}
    return {name: float(x) for name, x in positions.items() if isinstance(x, int | float)}


def _pose(body: Mapping[str, Any]) -> Pose:
    x, y, z = _vector(body.get("position"))
    return Pose((x, y, z), from_rpy(_vector(body.get("orientation_rpy"))))


def _vector(value: object) -> tuple[float, float, float]:
    if isinstance(value, list) and len(value) == 3:
        x, y, z = (float(v) if isinstance(v, int | float) else 0.0 for v in value)
        return (x, y, z)
    return (0.0, 0.0, 0.0)


def has_scenario(attachments: Mapping[str, bytes]) -> bool:
    """Return whether a recording brings the scenario of its run."""
    return layout.SCENARIO_ATTACHMENT in attachments
