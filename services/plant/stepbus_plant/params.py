"""The plant's parameters in a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import msgspec

from stepbus_participant.durations import parse_duration
from stepbus_schemas import WiringError

from .checked import NonNegative, Positive, find_problems, without_nulls
from .world.actions import Action, action_problems
from .world.file import Actuation
from .world.stock import StockParams

Quantity = Literal["position", "velocity", "effort"]


class Noise(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Standard deviation of the Gaussian noise on each sensed quantity."""

    position: NonNegative = 0.0
    """[rad]"""
    velocity: NonNegative = 0.0
    """[rad/s]"""
    effort: NonNegative = 0.0
    """[N·m]"""


class Resolution(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Distance between two values that a sensor tells apart; absent: it tells all apart."""

    position: Positive | None = None
    """[rad]"""
    velocity: Positive | None = None
    """[rad/s]"""
    effort: Positive | None = None
    """[N·m]"""


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What `params` of the plant may say."""

    world: str
    """World file: relative to the scenario, absolute, or `package://<package>/<path>`."""
    joints: list[str] | None = None
    """Joints that are sensed, in this order. Default: all movable ones, in the models' order.

    The others are driven and commanded alike, as the world says; they are only not sensed."""
    sense: tuple[Quantity, ...] = ("position", "velocity", "effort")
    """Quantities that are sensed."""
    noise: Noise = Noise()
    resolution: Resolution = Resolution()
    actuation: Actuation = "direct"
    """How mode torque is carried out, where the world does not say it for a joint."""
    effort: dict[str, NonNegative] = {}
    """Joint → largest torque of its motor [N·m], over the world's and the URDF's."""
    poses: list[str] | None = None
    """Links whose poses an output of type Poses/1 has, in this order. Default: all."""
    poses_period: str | None = None
    """From one Poses/1 to the next, a multiple of the step, e.g. `40ms`. Default: each step."""
    physics_step: str | None = None
    """Length of a physics substep over the world's, e.g. `8ms`: larger ones are faster."""
    cameras: bool = True
    """Whether cameras give images; without them a run is faster."""
    stock: StockParams | None = None
    """What stands on the shelves of a world with a stock. Default: that of seed 0."""
    script: list[Action] = []
    """What happens to the world in the run."""


def read_params(name: str, params: Mapping[str, Any]) -> Params:
    """Return a participant's `params` as frozen type.

    name: of the participant. Raises WiringError that lists all mistakes.
    """
    given = without_nulls(params)
    plain = {key: value for key, value in given.items() if key != "script"}
    found = [*find_problems(plain, Params), *action_problems(given.get("script", []))]
    problems = [(".".join(where), text) for where, text in found]
    if not problems:
        converted = msgspec.convert(given, Params)
        problems = _contradictions(converted)
        if not problems:
            return converted
    prefix = f"participants.{name}.params"
    raise WiringError(
        "\n".join(f"{prefix}{'.' if where else ''}{where}: {text}" for where, text in problems)
    )


def _contradictions(params: Params) -> list[tuple[str, str]]:
    """Return what is wrong among parameters that are fine one by one."""
    problems = []
    for key in ("noise", "resolution"):
        row = msgspec.structs.asdict(getattr(params, key))
        problems += [
            (f"{key}.{quantity}", f"{quantity} is not in 'sense' ({', '.join(params.sense)})")
            for quantity, value in row.items()
            if value and quantity not in params.sense
        ]
    for key in ("joints", "sense", "poses"):
        names = getattr(params, key) or []
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        problems += [(key, f"names {item!r} twice") for item in twice]
    if params.physics_step is not None:
        try:
            parse_duration(params.physics_step)
        except WiringError as exc:
            problems.append(("physics_step", str(exc)))
    if not params.sense:
        problems.append(("sense", "is empty; sense at least 'position'"))
    if params.joints == []:
        problems.append(("joints", "is empty; leave it out to sense all joints"))
    return problems
