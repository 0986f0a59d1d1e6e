"""Piecewise polynomials in time, with exact derivatives."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from stepbus_schemas import JointReference

Polynomial = tuple[float, ...]
"""Coefficients, lowest order first, in the time since the start of the segment."""


class PiecewisePolynomial:
    """A path through knots, at rest before the first and after the last.

    times: of the knots, increasing, shape (k,) [s]. joints: polynomials of each joint between two
    knots, n rows of k − 1. first, last: positions before and after, shape (n,) [rad]. duration:
    when it comes to rest [s].
    """

    def __init__(
        self,
        times: Sequence[float],
        joints: Sequence[Sequence[Polynomial]],
        first: Sequence[float],
        last: Sequence[float],
    ) -> None:
        self.duration = times[-1]
        self._times = list(times)
        self._segments = list(zip(*joints, strict=True))
        self._before, self._after = at_rest(first), at_rest(last)

    def at(self, t: float) -> JointReference:
        """Return position, velocity and acceleration at a time [s]."""
        if t < self._times[0]:
            return self._before
        if t > self._times[-1]:
            return self._after
        k = min(bisect_right(self._times, t), len(self._segments)) - 1
        since = t - self._times[k]
        position, velocity, acceleration = zip(
            *(evaluate(polynomial, since) for polynomial in self._segments[k]), strict=True
        )
        return JointReference(
            position=list(position), velocity=list(velocity), acceleration=list(acceleration)
        )


def at_rest(position: Sequence[float]) -> JointReference:
    """Return a constant reference; position: shape (n,) [rad]."""
    zeros = [0.0] * len(position)
    return JointReference(position=list(position), velocity=zeros, acceleration=zeros)


def evaluate(polynomial: Polynomial, u: float) -> tuple[float, float, float]:
    """Return value, first and second derivative of a polynomial at `u`.

    By Horner's rule, extended to derivatives (Knuth, The Art of Computer Programming 2, 4.6.4).
    """
    value = slope = half_curvature = 0.0
    for coefficient in reversed(polynomial):
        half_curvature = half_curvature * u + slope
        slope = slope * u + value
        value = value * u + coefficient
    return value, slope, 2.0 * half_curvature


Knot = tuple[float, float, float]
"""Position, velocity and acceleration of one joint [rad, rad/s, rad/s²]."""


def quintic(start: Knot, end: Knot, h: float) -> Polynomial:
    """Return the polynomial of order 5 from one knot to the next.

    h: time between them [s]. Between knots at rest it minimises jerk, the integral of the squared
    third derivative (Flash and Hogan, J. Neurosci. 5(7), 1985, appendix A).
    """
    p, v, a = start
    # What the extrapolated start motion lacks to reach the end, scaled to unit time.
    dp = end[0] - (p + v * h + 0.5 * a * h * h)
    dv = (end[1] - (v + a * h)) * h
    da = (end[2] - a) * h * h
    return (
        p,
        v,
        0.5 * a,
        (10.0 * dp - 4.0 * dv + 0.5 * da) / h**3,
        (-15.0 * dp + 7.0 * dv - da) / h**4,
        (6.0 * dp - 3.0 * dv + 0.5 * da) / h**5,
    )


def cubic(start: tuple[float, float], end: tuple[float, float], h: float) -> Polynomial:
    """Return the polynomial of order 3 between two positions with given velocities.

    start, end: position and velocity [rad, rad/s]. h: time between them [s].
    """
    p, v = start
    dp = end[0] - (p + v * h)
    dv = (end[1] - v) * h
    return (p, v, (3.0 * dp - dv) / h**2, (dv - 2.0 * dp) / h**3)


def natural_spline_velocities(times: Sequence[float], positions: Sequence[float]) -> list[float]:
    """Return the velocities at the knots of the natural cubic spline, shape (k,) [rad/s].

    times [s] and positions [rad] of the knots, shape (k,), k ≥ 2. The spline has a continuous
    acceleration that is zero at both ends (de Boor, A Practical Guide to Splines, 1978, chapter
    IV); the tridiagonal system is solved by forward elimination and back substitution.
    """
    steps = [b - a for a, b in pairwise(times)]
    slopes = [(b - a) / h for (a, b), h in zip(pairwise(positions), steps, strict=True)]
    upper, right = [0.5], [1.5 * slopes[0]]
    for i in range(1, len(steps)):
        h0, h1 = steps[i - 1], steps[i]
        pivot = 2.0 * (h0 + h1) - h1 * upper[-1]
        upper.append(h0 / pivot)
        wanted = 3.0 * (h1 * slopes[i - 1] + h0 * slopes[i])
        right.append((wanted - h1 * right[-1]) / pivot)
    velocity = (3.0 * slopes[-1] - right[-1]) / (2.0 - upper[-1])
    velocities = [velocity]
    for u, r in zip(reversed(upper), reversed(right), strict=True):
        velocity = r - u * velocity
        velocities.append(velocity)
    return velocities[::-1]
