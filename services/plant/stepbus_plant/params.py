"""The plant's parameters in a scenario."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import msgspec

from stepbus_participant import Duration, File, Names, NonNegative, Positive, Settings, Text
from stepbus_participant.parameters import Keys
from stepbus_schemas import WiringError

from .world.actions import Action
from .world.declaration import Actuation, StockParams, read_world

Quantity = Literal["position", "velocity", "effort"]


class Noise(Settings):
    """Standard deviation of the Gaussian noise on each sensed quantity."""

    position: NonNegative = 0.0
    """[rad]"""
    velocity: NonNegative = 0.0
    """[rad/s]"""
    effort: NonNegative = 0.0
    """[N·m]"""


class Resolution(Settings):
    """Distance between two values that a sensor tells apart; absent: it tells all apart."""

    position: Positive | None = None
    """[rad]"""
    velocity: Positive | None = None
    """[rad/s]"""
    effort: Positive | None = None
    """[N·m]"""


class Params(Settings):
    """What `params` of the plant may say."""

    world: File
    """World file: relative to the scenario, absolute, or `package://<package>/<path>`."""
    joints: Names | None = None
    """Joints that are sensed, in this order. Default: all movable ones, in the models' order.

    The others are driven and commanded alike, as the world says; they are only not sensed."""
    sense: tuple[Quantity, ...] = ("position", "velocity", "effort")
    """Quantities that are sensed."""
    noise: Noise = Noise()
    """Standard deviation of the Gaussian noise on each sensed quantity."""
    resolution: Resolution = Resolution()
    """Distance between two values that a sensor tells apart. Default: it tells all apart."""
    actuation: Actuation = "direct"
    """How mode torque is carried out, where the world does not say it for a joint."""
    effort: dict[str, NonNegative] = {}
    """Joint → largest torque of its motor [N·m], over the world's and the URDF's."""
    poses: tuple[Text, ...] | None = None
    """Links whose poses an output of type Poses/1 has, in this order. Default: all."""
    poses_period_ns: Duration | None = None
    """From one Poses/1 to the next, a multiple of the step, e.g. `40ms`. Default: each step."""
    physics_step_ns: Duration | None = None
    """Length of a physics substep over the world's, e.g. `8ms`: larger ones are faster."""
    cameras: bool = True
    """Whether cameras give images; without them a run is faster."""
    stock: StockParams | None = None
    """What stands on the shelves of a world with a stock. Default: that of seed 0."""
    script: tuple[Action, ...] = ()
    """What happens to the world in the run."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong among parameters that are fine one by one."""
        for key in ("noise", "resolution"):
            for quantity, value in msgspec.structs.asdict(getattr(self, key)).items():
                if value and quantity not in self.sense:
                    text = f"{quantity} is not in 'sense' ({', '.join(self.sense)})"
                    yield (key, quantity), text
        for key in ("sense", "poses"):
            names = getattr(self, key) or ()
            for name in dict.fromkeys(names):
                if names.count(name) > 1:
                    yield (key,), f"names {name!r} twice"
        if not self.sense:
            yield ("sense",), "is empty; sense at least 'position'"

    def file_problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the world file."""
        try:
            _, _, problems = read_world(self.world)
            problems.refuse()
        except WiringError as exc:
            for line in str(exc).splitlines():
                yield ("world",), line
