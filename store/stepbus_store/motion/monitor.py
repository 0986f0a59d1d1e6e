"""Finds what a robot touches or nears that its goal does not allow."""

import math
from collections.abc import Callable, Collection, Iterator
from typing import Literal, NamedTuple

from stepbus_schemas import Contacts, Point
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.sensed import MORE_FORCE, Approach, Collision, Watch

Moves = Literal["arm", "base", "all"]
"""What a goal moves; the gripper belongs to the arm."""

_CLOSER = 1e-5
"""Change of a distance in a step from which a link comes closer [m]."""

_SIDEWAYS = 0.3
"""Share of a link's speed that counts as coming closer, even if the gap has not become smaller."""

_STANDING = 1e-5
"""Movement in a step below which the direction of a link is not known [m]."""

_SUDDEN = 0.03
"""So much nearer than the range of the contacts, something new has not come from beyond it, even
if it is measured somewhat too near [m]."""

_GROUND_WITHIN = 5e-3
"""What the wheels are closer to at the start is what they stand on [m]."""

_ROLLS, _BEHIND = 0.05, 0.2
"""Speed from which a base drives away from what is behind it [m/s], and how far behind: cosine."""

_REACTION = 0.05
"""Until the arm begins to slow down [s]."""

_CLEARANCE = 2e-3
"""Distance from an obstacle at which the arm comes to rest [m]."""

_STOP, _STOP_HOLDING = 8.0, 5.0
"""Of any link in the hardest stop, without and with something in the gripper [m/s²]."""

_WARY = 0.25
"""Share of `creep` at which the arm creeps near what has stopped it before."""


class _Row(NamedTuple):
    """One pair of links, the robot's own (or what it holds) first; at: where, in the world [m]."""

    ours: str
    other: str
    force: float
    distance: float
    at: Point

    @property
    def pair(self) -> tuple[str, str]:
        return self.ours, self.other


_APART = 5e-3
"""Distance from which a thing that was between the pads counts as let go [m]."""

SpeedOf = Callable[[str], tuple[float, float]]
"""Speed of a link of the robot, or of what it holds, now and at the arm's full rate [m/s]."""


class Grasp:
    """Follows what is between the pads, from step to step.

    held: link of the world between them; empty: none. stood_on: what that touched when it was
    taken. around: links of the robot that were near it then. between: what is or was between the
    pads, until they have let go of it.
    """

    def __init__(self, params: Params, links: frozenset[str]) -> None:
        self._params, self._links = params, links
        self.held = ""
        self.stood_on: set[str] = set()
        self.around: set[str] = set()
        self.between: set[str] = set()

    def update(self, contacts: Contacts, *, holding: bool, grips: bool) -> None:
        """Take the contacts of a step; holding: the pads hold a thing, grips: a goal moves them."""
        one, other = (_touched_by(contacts, pad) for pad in self._params.pads)
        close = {link for pad in self._params.pads for link in _near(contacts, pad, _APART)}
        if grips:
            self.between |= {*one, *other}
        self.between &= close
        both = [link for link in one if link in other]
        if holding and both and self.held not in both:
            self.held = both[0]
            self.around = _near(contacts, self.held, self._params.slow_within) & self._links
            self.stood_on = _near(contacts, self.held, 1e-3) - self._links
        elif not holding and self.held and self.held not in both:
            self.between.add(self.held)
            self.held, self.stood_on, self.around = "", set(), set()


def _touched_by(contacts: Contacts, link: str) -> list[str]:
    """Return the links that press on a link, the hardest first."""
    rows = zip(contacts.pairs, contacts.force, strict=True)
    touching = [
        (-force, _other(pair, link)) for pair, force in rows if link in pair and force > 0.0
    ]
    return [name for _, name in sorted(touching)]


def _near(contacts: Contacts, link: str, within: float) -> set[str]:
    rows = zip(contacts.pairs, contacts.distance, strict=True)
    return {_other(pair, link) for pair, gap in rows if link in pair and gap < within}


def _other(pair: tuple[str, str], link: str) -> str:
    return pair[1] if pair[0] == link else pair[0]


def _stoppable(brake: float, gap: float) -> float:
    """Return the largest speed from which a link stops within a gap [m, m/s].

    The path of reaction and braking, v·t + v²/2a, ends at the clearance. brake: a [m/s²].
    """
    before, room = brake * _REACTION, max(gap - _CLEARANCE, 0.0)
    return math.sqrt(before**2 + 2.0 * brake * room) - before


class CollisionMonitor:
    """Finds what a robot touches that its goal does not allow, step by step.

    The pads may touch `touches`, what is held until they have let go of it, and anything while they
    grip, but no harder than a grip takes, and where they do not grip, not press on it; what is held
    may touch `touches` and what it touched when it was taken; wheels and casters may touch the
    ground. A touch that is there when a goal starts counts only once it becomes harder, so that the
    robot can leave. Near things, other than what is held and moves along, slow the arm down, so
    that each link can stop before it touches them; a link that passes by counts with a share of its
    speed.

    links: of the robot; base_links: those that only the base moves, not the arm. ignore: wheels and
    casters.
    """

    def __init__(
        self,
        params: Params,
        *,
        links: frozenset[str],
        base_links: frozenset[str],
        ignore: frozenset[str],
    ) -> None:
        self._params = params
        self._links, self._base_links, self._ignore = links, base_links, ignore
        self.range = params.contact_range
        """Range of the contact sensors [m]."""
        self.slow_within = params.slow_within
        """Distance from which on the arm slows down [m]."""
        self._ground: set[str] = set()
        self._grasp = Grasp(params, links)
        self._ours = links
        self._special = ignore.union(params.pads)
        self._touches: frozenset[str] = frozenset()
        self._grips = False
        self._moves: Moves = "all"
        self._known: dict[tuple[str, str], float] = {}
        self._last: list[_Row] = []
        self._closing: list[_Row] = []
        self._gaps: dict[tuple[str, str], float] = {}
        self._feet: dict[tuple[str, str], Point] = {}
        self._middle = self._velocity = (0.0, 0.0)
        self.wary: frozenset[str] = frozenset()
        """Links that have stopped the arm before."""

    @property
    def held(self) -> str:
        """Return the link of the world between the pads; empty: none."""
        return self._grasp.held

    def start(
        self, touches: Collection[str] = (), *, grips: bool = False, moves: Moves = "all"
    ) -> None:
        """Start to monitor a goal; touches: links of the world that it may touch.

        grips: whether it moves the pads. moves: what it moves; what cannot come closer by that
        slows nothing down.
        """
        self._touches = frozenset(touches)
        self._grips, self._moves = grips, moves
        self._known = {row.pair: row.force for row in self._last if row.force > 0.0}

    def update(
        self,
        contacts: Contacts,
        *,
        holding: bool,
        dt: float,
        speed_of: SpeedOf = lambda _: (1.0, 1.0),
        base_speed: float = 0.0,
    ) -> Watch:
        """Check the contacts of a step, dt [s] after the last.

        holding: the pads hold a thing. base_speed: of the fastest point that the base moves [m/s].
        """
        self._learn_ground(contacts)
        self._follow_base(contacts, dt)
        held = self.held
        self._grasp.update(contacts, holding=holding, grips=self._grips)
        if self.held != held:
            taken = {self.held} - {""}
            self._ours = self._links | taken
            self._special = self._ignore.union(self._params.pads, taken)
        self._gaps = {row.pair: row.distance for row in self._last}
        self._last = list(self._rows(contacts))
        watched = [row for row in self._last if not self._is_allowed(row)]
        self._closing = [row for row in watched if self._may_close(row)]
        close = [row for row in self._closing if row.distance < self._params.slow_within]
        nearest = min(close, key=lambda row: row.distance, default=None)
        scale, room = 1.0, math.inf
        unexpected: list[tuple[Approach, float]] = []
        for row in self._closing:
            now, full = self._speeds(row, speed_of)
            closer = self._closer(row, dt * (now + base_speed))
            scale = min(scale, self._share(row, closer * full))
            if not self.is_ours(row.other) and not self._leaves(row):
                room = min(room, row.distance / closer)
            if not (self._links.issuperset(row.pair) or self.is_base(row.ours)):
                near = Approach(ours=row.ours, other=row.other, gap=max(row.distance, 0.0))
                unexpected.append((near, self._left(row, now + base_speed, dt)))
        # What stands just beyond the range of the contacts can still be stopped before.
        unseen = _stoppable(self._hardest_brake, self.range)
        fastest = max((speed_of(pad)[1] for pad in self._params.pads), default=0.0)
        if fastest * scale > unseen and self._moves != "base":
            scale = unseen / fastest
        return Watch(
            collision=self._hardest([*watched, *self._pressed()]),
            near=nearest.pair if nearest else None,
            gap=max(nearest.distance, 0.0) if nearest else self._params.slow_within,
            scale=scale,
            room=min(max(room, 0.0), self.range),
            unexpected=tuple(sorted(unexpected, key=lambda pair: pair[1])),
        )

    @property
    def _hardest_brake(self) -> float:
        return _STOP_HOLDING if self.held else _STOP

    def _left(self, row: _Row, moves: float, dt: float) -> float:
        """Return the distance that the hardest stop would leave, see `Watch.unexpected`.

        What appears all of a sudden comes as fast as the link moves at all [m/s].
        """
        before, speed = self._gaps.get(row.pair), 0.0
        if before is not None:
            speed = max((before - row.distance) / dt, 0.0)
        elif row.distance < self.range - _SUDDEN:
            speed = moves
        return row.distance - (speed * _REACTION + speed**2 / (2.0 * self._hardest_brake))

    def approach(self, *, besides: str = "") -> Approach | None:
        """Return the closest pair, other than with one link, that has just come all too close."""
        close = [
            row
            for row in self._closing
            if row.distance < self._params.base_halt
            and not self.is_ours(row.other)
            and not self._leaves(row)
            and row.distance < self._gaps.get(row.pair, 0.0) - _CLOSER
            and row.other != besides
        ]
        nearest = min(close, key=lambda row: row.distance, default=None)
        if nearest is None:
            return None
        return Approach(ours=nearest.ours, other=nearest.other, gap=nearest.distance)

    def touch(self, pair: tuple[str, str]) -> tuple[float, float | None]:
        """Return force [N] and distance [m] of a pair, the robot's link first; None: it is far."""
        rows = ((row.force, row.distance) for row in self._last if row.pair == pair)
        return next(rows, (0.0, None))

    def _share(self, row: _Row, closing: float) -> float:
        """Return the share of the full rate at which two links can stop before they touch.

        Speed and separation monitoring: ISO/TS 15066, 2016, section 5.5.4.
        closing: how fast they come closer at the full rate [m/s].
        """
        if row.distance >= self._params.slow_within:
            return 1.0
        # Where base and arm move, each of them may use up one half.
        gap = row.distance / 2 if self._moves == "all" else row.distance
        creep = self._params.arm_creep * (_WARY if row.other in self.wary else 1.0)
        speed = max(_stoppable(self._params.arm_brake, gap), creep)
        return min(speed / max(closing, 1e-9), 1.0)

    def _speeds(self, row: _Row, speed_of: SpeedOf) -> tuple[float, float]:
        """Return how fast two links move, now and at the arm's full rate [m/s]."""
        speeds = [speed_of(link) for link in row.pair if self.is_ours(link)]
        return sum(now for now, _ in speeds), sum(full for _, full in speeds)

    def _closer(self, row: _Row, moved: float) -> float:
        """Return by which share of the way that two links have moved they came closer [m]."""
        before = self._gaps.get(row.pair)
        if before is None:
            # What has come from beyond the range may pass by.
            return _SIDEWAYS if row.distance >= self.range - _SUDDEN else 1.0
        share = (before - row.distance) / max(moved, _STANDING)
        return min(max(share, _SIDEWAYS), 1.0)

    def _hardest(self, watched: list[_Row]) -> Collision | None:
        hard = [
            row
            for row in watched
            if row.force > self._params.collision_force
            and row.force > self._known.get(row.pair, -1e9) + MORE_FORCE
        ]
        worst = max(hard, key=lambda row: row.force, default=None)
        if worst is None:
            return None
        return Collision(ours=worst.ours, other=worst.other, force=worst.force)

    def _rows(self, contacts: Contacts) -> Iterator[_Row]:
        """Yield the pairs of the robot, or of what it holds, with anything else."""
        columns = contacts.pairs, contacts.peaks, contacts.distance, contacts.position
        ours = self._ours
        for (one, other), force, distance, at in zip(*columns, strict=True):
            if one in ours:
                yield _Row(one, other, force, distance, at)
            elif other in ours:
                yield _Row(other, one, force, distance, at)

    def is_ours(self, link: str) -> bool:
        """Return whether a link is the robot's, or held by it."""
        return link in self._ours

    def is_base(self, link: str) -> bool:
        """Return whether only the base moves a link."""
        return link in self._base_links

    def _learn_ground(self, contacts: Contacts) -> None:
        """Record the links that wheels and casters touch at the start as the ground."""
        if self._ground:
            return
        for pair, distance in zip(contacts.pairs, contacts.distance, strict=True):
            if distance < _GROUND_WITHIN and self._ignore.intersection(pair):
                self._ground.update(set(pair) - self._links)

    def _follow_base(self, contacts: Contacts, dt: float) -> None:
        """Record where the base is, and its velocity, by the points on which its wheels stand."""
        before = self._feet
        rows = zip(contacts.pairs, contacts.position, contacts.distance, strict=True)
        self._feet = {
            pair: at for pair, at, gap in rows if gap < _GROUND_WITHIN and self._is_foot(pair)
        }
        feet = [(at, before[pair]) for pair, at in self._feet.items() if pair in before]
        count = max(len(feet), 1)
        x, y = (sum(at[n] for at, _ in feet) / count for n in (0, 1))
        vx, vy = (sum(at[n] - was[n] for at, was in feet) / count / dt for n in (0, 1))
        self._middle, self._velocity = (x, y), (vx, vy)

    def _is_foot(self, pair: Collection[str]) -> bool:
        """Return whether a wheel or caster is near the ground."""
        return not (self._ignore.isdisjoint(pair) or self._ground.isdisjoint(pair))

    def _leaves(self, row: _Row) -> bool:
        """Return whether the base drives away from something: to brake for it would not help."""
        (x, y), (vx, vy) = self._middle, self._velocity
        dx, dy = row.at[0] - x, row.at[1] - y
        speed = math.hypot(vx, vy)
        behind = dx * vx + dy * vy < -_BEHIND * speed * math.hypot(dx, dy)
        return self.is_base(row.ours) and speed > _ROLLS and behind

    def _is_allowed(self, row: _Row) -> bool:
        if self._special.isdisjoint(row.pair):
            return False
        pair = set(row.pair)
        if self._is_foot(pair):
            return True
        others = pair.difference(self._params.pads)
        if others != pair:
            soft = self._touches | self._grasp.between | {self.held}
            return self._grips or not others or bool(others & soft)
        if self.held in pair:
            return bool((pair - {self.held}) & (self._touches | self._grasp.stood_on))
        return False

    def _pressed(self) -> list[_Row]:
        """Return the permitted contacts of pads that press too hard, or without gripping."""
        rows = []
        for row in self._last:
            others = {row.ours, row.other}.difference(self._params.pads)
            if len(others) == 1 and self._is_allowed(row):
                grips = self._grips or bool(others & (self._grasp.between | {self.held}))
                if row.force > (self._params.grip_force if grips else MORE_FORCE):
                    rows.append(row)
        return rows

    def _may_close(self, row: _Row) -> bool:
        """Return whether the goal under way can make a gap smaller.

        It cannot between what is held and a link around it, as the palm; between the world and a
        base that stands; between two links of a robot of which only the base moves, or which has
        checked its motion for that.
        """
        pair = {row.ours, row.other}
        if self._params.srdf is not None and pair <= self._links:
            return False
        if self.held in pair and pair & self._grasp.around:
            return False
        both_ours = self.is_ours(row.other)
        if self._moves == "base":
            return not both_ours
        return both_ours or not (self._moves == "arm" and self.is_base(row.ours))
