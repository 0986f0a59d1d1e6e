"""References that excite a robot, to identify or to try it: chirp, ramp, impulse, noise.

Each is a `task` by its class, such as `stepbus_mission.excitation:Chirp`. The velocities and
accelerations are the exact derivatives wherever there are any; where a position jumps, they are
zero.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cache

from stepbus_mission.polynomials import at_rest
from stepbus_participant import NonNegative, PerJoint, Positive, Settings, Whole, each
from stepbus_participant.parameters import Keys
from stepbus_schemas import JointReference

_REGISTER = 15
"""Length of the shift register: the sequence repeats after 2¹⁵ − 1 bits."""
_FIRST_START = 10582
"""Start for seed 0, selected from 886: the first 100 bits have means of at most 0.26, for seeds
below 16 and up to seven joints. From 0, where the register is almost empty, 79 of 100 bits are
negative."""
_SEED_STRIDE = 20252
"""Bits from a seed to the next: 0.618 of the sequence, as the golden ratio spreads points evenly,
and without a common divisor with its length."""
_BIT_ENDS = 1e-9
"""A time that is no more than this before the end of a bit is at it [s]."""


class ChirpParams(Settings):
    """Parameters of `stepbus_mission.excitation:Chirp`."""

    amplitude: PerJoint = each(1.0)
    """Amplitude A in q(t) = q0 + A · sin φ(t) [rad]."""
    offset: PerJoint = each(0.0)
    """q0 [rad]."""
    omega: Positive = 1.0
    """Angular frequency dφ/dt at the start [rad/s]."""
    omega_end: Positive = 20.0
    """Angular frequency dφ/dt from `sweep` on; it changes linearly until then [rad/s]."""
    sweep: Positive = 10.0
    """Duration of the sweep [s]."""


class Chirp:
    """A sine whose angular frequency goes evenly from one to another, and stays there."""

    Params = ChirpParams

    def __init__(self, joints: Sequence[str], params: ChirpParams) -> None:
        self._sweep, self._omega, self._end = params.sweep, params.omega, params.omega_end
        self._rows = tuple(zip(params.amplitude.of(joints), params.offset.of(joints), strict=True))

    def at(self, t: float) -> JointReference:
        """See `stepbus_mission.generators.Generator`."""
        swept, rate = min(t, self._sweep), (self._end - self._omega) / self._sweep
        omega = self._omega + rate * swept
        angle = self._omega * swept + rate * swept**2 / 2 + self._end * (t - swept)
        slope = rate if t < self._sweep else 0.0
        sin, cos = math.sin(angle), math.cos(angle)
        return JointReference(
            position=[offset + a * sin for a, offset in self._rows],
            velocity=[a * omega * cos for a, _ in self._rows],
            acceleration=[a * (slope * cos - omega**2 * sin) for a, _ in self._rows],
        )


class RampParams(Settings):
    """Parameters of `stepbus_mission.excitation:Ramp`."""

    initial: PerJoint = each(0.0)
    """Position before `time` [rad]."""
    target: PerJoint
    """Position at the end [rad]."""
    time: NonNegative = 0.0
    """Start of the ramp [s]."""
    rise: Positive = 1.0
    """Duration of the ramp [s]."""


class Ramp:
    """Goes from one position to another at a constant velocity."""

    Params = RampParams

    def __init__(self, joints: Sequence[str], params: RampParams) -> None:
        self._time, self._rise = params.time, params.rise
        self._initial, self._target = params.initial.of(joints), params.target.of(joints)
        self.duration = params.time + params.rise

    def at(self, t: float) -> JointReference:
        """See `stepbus_mission.generators.Generator`."""
        if t < self._time:
            return at_rest(self._initial)
        if t >= self.duration:
            return at_rest(self._target)
        share = (t - self._time) / self._rise
        shift = [end - start for start, end in zip(self._initial, self._target, strict=True)]
        return JointReference(
            position=[q + share * by for q, by in zip(self._initial, shift, strict=True)],
            velocity=[by / self._rise for by in shift],
            acceleration=[0.0] * len(shift),
        )


class ImpulseParams(Settings):
    """Parameters of `stepbus_mission.excitation:Impulse`."""

    initial: PerJoint = each(0.0)
    """Position before and after the pulse [rad]."""
    height: PerJoint = each(0.1)
    """Height of the pulse [rad]."""
    time: NonNegative = 0.0
    """Start of the pulse [s]."""
    width: Positive = 0.05
    """Duration of the pulse; the shortest is one step of the run [s]."""


class Impulse:
    """Jumps away from a position, and back."""

    Params = ImpulseParams

    def __init__(self, joints: Sequence[str], params: ImpulseParams) -> None:
        self._time = params.time
        initial = params.initial.of(joints)
        self._rest = at_rest(initial)
        self._peak = at_rest(
            [q + h for q, h in zip(initial, params.height.of(joints), strict=True)]
        )
        self.duration = params.time + params.width

    def at(self, t: float) -> JointReference:
        """See `stepbus_mission.generators.Generator`."""
        is_up = self._time - _BIT_ENDS <= t < self.duration - _BIT_ENDS
        return self._peak if is_up else self._rest


class NoiseParams(Settings):
    """Parameters of `stepbus_mission.excitation:Noise`."""

    amplitude: PerJoint = each(0.1)
    """Amplitude: the position is `offset` ± this [rad]."""
    offset: PerJoint = each(0.0)
    """Mean position [rad]."""
    hold: Positive = 0.1
    """Duration of each bit [s]."""
    seed: Whole = 0
    """Start of the first joint in the sequence, thousands of bits from that of the next seed; the
    other joints start evenly spaced after it."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the length of a bit."""
        if self.hold <= _BIT_ENDS:
            yield ("hold",), f"is {self.hold:g} s; it must be longer than {_BIT_ENDS:g} s"


class Noise:
    """A pseudo-random binary sequence (PRBS-15, x¹⁵ + x¹⁴ + 1, ITU-T O.150), the same every time.

    Its spectrum is flat up to about 0.4 / `hold` [Hz].
    """

    Params = NoiseParams

    def __init__(self, joints: Sequence[str], params: NoiseParams) -> None:
        self._hold = params.hold
        amplitudes, offsets = params.amplitude.of(joints), params.offset.of(joints)
        apart = len(_sequence()) // len(joints)
        first = _FIRST_START + _SEED_STRIDE * params.seed
        starts = [first + apart * number for number in range(len(joints))]
        self._rows = tuple(zip(amplitudes, offsets, starts, strict=True))

    def at(self, t: float) -> JointReference:
        """See `stepbus_mission.generators.Generator`."""
        bits = _sequence()
        bit = math.floor((t + _BIT_ENDS) / self._hold)
        return at_rest([q + a * bits[(start + bit) % len(bits)] for a, q, start in self._rows])


@cache
def _sequence() -> tuple[int, ...]:
    """Return the bits of a shift register with feedback, as −1 and 1."""
    register, bits = 1, []
    for _ in range(2**_REGISTER - 1):
        new = (register >> (_REGISTER - 1) ^ register >> (_REGISTER - 2)) & 1
        register = (register << 1 | new) & (2**_REGISTER - 1)
        bits.append(1 if new else -1)
    return tuple(bits)
