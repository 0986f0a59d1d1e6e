"""Warnings about commands that cannot take effect: each cause once per joint, with its numbers."""

import math
from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from stepbus_plant.joint import Joint
from stepbus_plant.params import Params
from stepbus_schemas import JointCommand, JointState

# Joint limits are often a full turn, rounded up [rad].
_FULL_TURN = 2 * math.pi + 1e-3
# Two joints count as swapped if each target misses the other joint's position by less than this
# share of the distance between the two.
_SWAPPED = 0.1
# A target closer than this to its joint's position is right [rad, m].
_LEAST_SWAP = 0.01


class Warnings:
    """Collects warnings about commands until they are taken.

    Each cause is reported once per subject: a controller that commands the impossible does so at
    every step. reported: (subject, cause). pending: those since the last call of `take`.
    """

    def __init__(self) -> None:
        self.reported: set[tuple[str, str]] = set()
        self.pending: list[str] = []

    def add(self, subject: str, cause: str, text: str) -> None:
        """Add a warning, unless this cause has been reported for this subject."""
        if (subject, cause) not in self.reported:
            self.reported.add((subject, cause))
            self.pending.append(f"{subject}: {text}")

    def take(self) -> list[str]:
        """Return the warnings since the last call, one sentence each."""
        new, self.pending = self.pending, []
        return new

    def check(self, joints: Sequence[Joint], command: JointCommand) -> None:
        """Warn about each part of a command that cannot take effect; its vectors fit the joints."""
        limits = command.effort_limit
        for index, joint in enumerate(joints):
            value = command.values[index]
            effort = joint.effort if limits is None else min(joint.effort, limits[index])
            if joint.mimic is not None:
                text = (
                    f"follows joint {joint.mimic.joint!r} (<mimic> of its URDF); command that one"
                )
                self._add(joint, "mimic", text)
            elif not joint.motor:
                text = "has no motor (world file: motor: false); it swings freely"
                self._add(joint, "motor", text)
            elif command.mode == "torque":
                self._check_torque(joint, value)
            elif effort == 0.0:
                text = f"has an effort limit of 0 {joint.effort_unit}; nothing moves it"
                self._add(joint, "effort", text)
            elif command.mode == "position":
                self._check_target(joint, value)
                if command.velocity is not None:
                    self._check_target_velocity(joint, command.velocity[index])
            elif 0 < joint.max_velocity < abs(value):
                text = f"{value:g} {joint.unit}/s exceeds its limit of {joint.max_velocity:g}"
                self._add(joint, "velocity", f"{text}; limited to it")

    def _check_torque(self, joint: Joint, value: float) -> None:
        if abs(value) > joint.effort:
            text = f"{value:g} {joint.effort_unit} exceeds its limit of {joint.effort:g}"
            self._add(joint, "torque", f"{text}; limited to it")

    def _check_target(self, joint: Joint, value: float) -> None:
        if not joint.lower <= value <= joint.upper:
            stop = joint.lower if value < joint.lower else joint.upper
            text = f"target {value:g} {joint.unit} is beyond its stop at {stop:g}; limited to it"
            hint = degrees_hint(joint, value)
            # A sinusoid in degrees starts within a turn; the hint should still come.
            self._add(joint, "turn" if hint else "stop", text + hint)
        elif hint := degrees_hint(joint, value):
            self._add(joint, "turn", f"target {value:g} rad is more than a full turn{hint}")

    def _check_target_velocity(self, joint: Joint, velocity: float) -> None:
        # Tolerate the rounding error of a sender that moves exactly at the limit.
        if 0 < 1.001 * joint.max_velocity < abs(velocity):
            speed = f"{velocity:g} {joint.unit}/s"
            text = f"its target moves at {speed}, its limit is {joint.max_velocity:g}"
            self._add(joint, "target velocity", f"{text}; it falls behind")

    def check_start(
        self, joints: Sequence[Joint], positions: Sequence[float], targets: Sequence[float]
    ) -> None:
        """Warn about pairs of joints whose first targets are each other's positions.

        positions, targets: shape (n,), [rad]. A distant target alone is not a mistake.
        """
        states = list(zip(joints, positions, targets, strict=True))
        moving = [state for state in states if abs(state[2] - state[1]) > _LEAST_SWAP]
        for (one, at_one, to_one), (two, at_two, to_two) in combinations(moving, 2):
            tolerance = _SWAPPED * abs(at_one - at_two)
            if abs(to_one - at_two) <= tolerance and abs(to_two - at_one) <= tolerance:
                self.add(
                    f"joints {one.name} and {two.name}",
                    "swapped",
                    f"are at {at_one:g} and {at_two:g} {one.unit}, their first targets are "
                    f"{to_one:g} and {to_two:g}; are the two swapped?",
                )

    def _add(self, joint: Joint, cause: str, text: str) -> None:
        self.add(f"joint {joint.name}", cause, text)


def degrees_hint(joint: Joint, position: float) -> str:
    """Return the end of a sentence if a position looks like degrees instead of radians."""
    if not joint.is_rotary or not _FULL_TURN < abs(position) < math.inf:
        return ""
    return f"; is it in degrees? {position:g}° is {math.radians(position):.4f} rad"


Values = list[float]
"""One number per sensed joint."""


class Sensors:
    """Turns true joint states into sensor readings.

    seed: of the noise. Each quantity has its own random stream, so that the noise on one does not
    change the noise on another.
    """

    def __init__(self, params: Params, seed: int) -> None:
        self._random = [np.random.PCG64([seed, number]) for number in range(3)]

        def make(number: int, quantity: str) -> Callable[[Values], Values | None]:
            return _sensor(params, quantity, np.random.Generator(self._random[number]))

        self._position = make(0, "position")
        self._velocity = make(1, "velocity")
        self._effort = make(2, "effort")

    def sense(
        self, position: Values, velocity: Values, effort: Values, target: Values | None
    ) -> JointState:
        """Return the readings of true positions, velocities and efforts; targets have no noise."""
        return JointState(
            position=self._position(position),
            velocity=self._velocity(velocity),
            effort=self._effort(effort),
            target=target,
        )

    def save(self) -> list[tuple[str, str]]:
        """Return how far each random stream is, for a checkpoint."""
        states = [random.state["state"] for random in self._random]
        return [(str(state["state"]), str(state["inc"])) for state in states]

    def restore(self, saved: Sequence[tuple[str, str]]) -> None:
        """Take what `save` returned."""
        for random, (state, increment) in zip(self._random, saved, strict=True):
            full = random.state
            full["state"] = {"state": int(state), "inc": int(increment)}
            random.state = full


def _sensor(
    params: Params, quantity: str, random: np.random.Generator
) -> Callable[[Values], Values | None]:
    """Return the function from true to sensed values of one quantity."""
    noise: float = getattr(params.noise, quantity)
    resolution: float | None = getattr(params.resolution, quantity)

    def disturbed(values: Values) -> Values:
        sensed = np.asarray(values)
        if noise:
            sensed = sensed + noise * random.standard_normal(len(values))
        if resolution is not None:
            sensed = resolution * np.round(sensed / resolution)
        return [float(value) for value in sensed]

    if quantity not in params.sense:
        return lambda _: None
    return disturbed if noise or resolution is not None else lambda values: values
