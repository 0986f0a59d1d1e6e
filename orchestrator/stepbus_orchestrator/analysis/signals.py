"""Joint signals of a recording as arrays, brought together by joint name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Port, Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One port over time.

    names: of the joints. steps: shape (m,). t: simulation time, shape (m,), [s]. fields:
    quantity → values, shape (m, n). limits: as in the port's description. joint_types: joint → its
    type, where the description gives it.
    """

    names: Sequence[str]
    steps: NDArray[np.int64]
    t: Array
    fields: Mapping[str, Array]
    limits: Mapping[str, Sequence[float]] = field(default_factory=dict)
    joint_types: Mapping[str, str] = field(default_factory=dict)

    def of(self, quantity: str, joint: str) -> Array | None:
        """Return one quantity of one joint, shape (m,); None where there is none."""
        if quantity not in self.fields or joint not in self.names:
            return None
        values: Array = self.fields[quantity][:, list(self.names).index(joint)]
        return values

    def held_at(self, steps: NDArray[np.int64], values: Array) -> Array:
        """Return values of this signal at other steps, held until the next; NaN outside."""
        index = np.searchsorted(self.steps, steps, side="right") - 1
        every = int(self.steps[1] - self.steps[0]) if len(self.steps) > 1 else 1
        known = (index >= 0) & (steps < self.steps[-1] + every)
        held: Array = np.where(known, values[np.maximum(index, 0)], np.nan)
        return held


def read_signal(port: Port, quantities: Sequence[str]) -> Signal | None:
    """Return a port as arrays; None when it has no messages, or none of a constant width."""
    arrays = port.arrays(*quantities)
    if not len(port):
        return None
    fields = {
        quantity: values.astype(float)
        for quantity, values in arrays.items()
        if values is not None and values.dtype != object and values.ndim == 2
    }
    width = max((values.shape[1] for values in fields.values()), default=0)
    names = port.names or [f"joint {i + 1}" for i in range(width)]
    if any(values.shape[1] != len(names) for values in fields.values()):
        return None
    described = port.description
    types = dict(zip(names, described.details.get("type", []), strict=False))
    return Signal(
        names=names,
        steps=port.steps,
        t=port.t,
        fields=fields,
        limits=described.limits,
        joint_types=types,
    )


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """What the classic plots of joint control need.

    state, reference, command: the first port of each type; absent where there is none.
    command: of mode torque only.
    joints: those that state and reference share, in the state's order.
    """

    state: Signal | None
    reference: Signal | None
    command: Signal | None

    @property
    def joints(self) -> list[str]:
        """Return the joints that are both measured and in the reference."""
        if self.state is None or self.reference is None:
            return []
        return [name for name in self.state.names if name in self.reference.names]

    def error(self, joint: str) -> Array:
        """Return reference minus measured position, shape (m,), at the steps of the state."""
        state, reference = self.state, self.reference
        measured = None if state is None else state.of("position", joint)
        wanted = None if reference is None else reference.of("position", joint)
        if state is None or reference is None or measured is None or wanted is None:
            return np.full(0 if state is None else len(state.steps), np.nan)
        return reference.held_at(state.steps, wanted) - measured


def read_tracking(recording: Recording) -> Tracking:
    """Return the joint signals of a recording."""
    found = {
        type_name: _first(recording, type_name, quantities)
        for type_name, quantities in (
            ("JointState/1", ("position", "velocity", "effort", "target")),
            ("JointReference/1", ("position", "velocity", "acceleration")),
        )
    }
    return Tracking(
        state=found["JointState/1"],
        reference=found["JointReference/1"],
        command=_torques(recording),
    )


def _torques(recording: Recording) -> Signal | None:
    """Return the first port that commands torques, and nothing else but to brake."""
    for port in recording.of_type("JointCommand/1"):
        found = port.arrays("mode", "values")["mode"]
        modes = set() if found is None else set(found)
        if "torque" in modes and modes <= {"torque", "brake"}:
            return read_signal(port, ("values",))
    return None


def _first(recording: Recording, type_name: str, quantities: Sequence[str]) -> Signal | None:
    ports = recording.of_type(type_name)
    return read_signal(ports[0], quantities) if ports else None


def tracking_rmse(tracking: Tracking, after_s: float = 2.0) -> dict[str, float]:
    """Return the root mean square of each joint's tracking error [rad].

    after_s: what comes before is left out [s]. The closing sample has no reference and is left
    out too.
    """
    state, reference = tracking.state, tracking.reference
    if state is None or reference is None:
        return {}
    chosen = state.t >= after_s
    rows = {joint: tracking.error(joint)[chosen] for joint in tracking.joints}
    return {
        joint: float(np.sqrt(np.nanmean(e**2)))
        for joint, e in rows.items()
        if not np.isnan(e).all()
    }
