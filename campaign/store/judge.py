"""Judges a sale by its recording: forces, rest, and whether what is reported is so."""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack

from campaign.log_reader import Log

from .braking import IN_THE_WAY, STEP_S, avoidable

MOST_FORCE = 50.0
"""Of the robot on anything but the ground [N]."""

_AT_REST = 0.02
"""Velocity below which a link or a joint is at rest [m/s, rad/s]."""

_NEAR = 0.05
"""With locked wheels the base slides 46 mm from 0.6 m/s; what appears nearer may be hit [m]."""

_HIT_FOR_STEPS = 63
"""How long after it has appeared: 1 s."""

_WORTH_A_WORD = 5.0
"""A touch that lasts longer than `_FOR_STEPS` with more than that is to be reported [N]."""

_FOR_STEPS = 3
_MEASURED = 0.008
"""Largest difference between the place error that is reported and the true one [m]."""

_OUTLET = (0.15, 0.65, 0.35)
"""The only spot of a single order, on top of the outlet [m]."""

_TOUCH = re.compile(r"\b(\w+) touches (?!it )(\w+) with ([\d.]+) N")
_STILL = re.compile(_TOUCH.pattern + r"; stopped[^;]*still touches it with ([\d.]+) N")
_APART = re.compile(_TOUCH.pattern + r"; stopped[^;]*now ([\d.]+) mm from it")
_SAME_FORCE, _SAME_GAP = 0.051, 2e-3
"""Largest differences between what is reported and what is in the log [N, m]."""

_SOLD = re.compile(r"^1 +(\w+) +\d+ +(?:-|[\d.]+ mm) +([\d.]+) mm", re.MULTILINE)
_AFTER = re.compile(r"from its spot after ([\d.]+) s")
_MOVED = re.compile(r"\b(\w+) was moved by ([\d.]+) mm")
_GROUND = ("floor",)
_ROLLING = ("left_wheel_link", "right_wheel_link", "front_caster", "back_caster")
_PADS = ("left_pad", "right_pad")


Row = tuple[int, Mapping[str, Any]]


@dataclass
class SaleLog:
    """Topic → messages with their steps, in file order; topic → names of its description.

    bodies: link → the body of the world that it belongs to. is_whole: whether the recording could
    be read to its end.
    """

    messages: dict[str, list[Row]] = field(default_factory=lambda: defaultdict(list))
    names: dict[str, list[str]] = field(default_factory=dict)
    bodies: dict[str, str] = field(default_factory=dict)
    is_whole: bool = True

    def last(self, topic: str) -> Mapping[str, Any]:
        """Return the last message of a topic; empty: there is none."""
        rows = self.messages.get(topic)
        return rows[-1][1] if rows else {}

    @property
    def sold_after(self) -> float:
        """Return how long the only sale took until the item was placed [s]; 0: it is not."""
        times = [float(row) for text in self.texts() for row in _AFTER.findall(text)]
        return times[0] if times else 0.0

    def texts(self) -> Iterator[str]:
        """Yield every sentence of mission and controller."""
        for topic in ("mission/events", "mission/summary", "controller/goal_status"):
            yield from (row.get("text", "") for _, row in self.messages.get(topic, ()))
        for _, row in self.messages.get("controller/status", ()):
            yield from row.get("warnings", ())


_READ = (
    "plant/contacts", "plant/gripper", "plant/joint_state", "plant/odometry", "plant/poses",
    "controller/goal_status", "controller/status", "mission/events", "mission/summary",
)  # fmt: skip


def decoded(log: Log) -> SaleLog:
    """Return what a recording of the store holds."""
    sale = SaleLog(is_whole=not log.damage)
    for topic, channel in log.channels.items():
        about = json.loads(channel.metadata.get("description", "{}"))
        sale.names[topic] = about.get("names", [])
        if topic == "plant/poses":
            sale.bodies = dict(zip(about["names"], about["details"]["body"], strict=True))
    for row in log.rows:
        if row.topic in _READ:
            sale.messages[row.topic].append((row.step, msgpack.unpackb(row.content)))
    return sale


@dataclass
class Excuses:
    """What no robot can avoid: something is put into it, or nearer than it can brake.

    overlaps: the step from which on something is inside the robot, or has run into it, after which
    no force says anything. hits: link → steps in which it may be hit, with sentences.
    """

    overlaps: float = math.inf
    ran_into: list[str] = field(default_factory=list)
    hits: dict[str, range] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)

    def covers(self, pair: Sequence[str], step: int) -> bool:
        """Return whether a force between two links at a step could not be avoided."""
        return step >= self.overlaps or any(step in self.hits.get(link, ()) for link in pair)


def excuses(log: SaleLog, script: Sequence[Mapping[str, Any]]) -> Excuses:
    """Return what a robot could not avoid; script: actions of the plant."""
    excused, ours = Excuses(), set(log.names.get("plant/contacts", ()))
    for action in script:
        if "body" not in action:
            continue
        at = math.ceil(float(str(action["at"]).removesuffix("s")) / STEP_S - 1e-6)
        # Put there at the beginning of a step, it is measured at the end of that.
        rows = (row for row in log.messages.get("plant/contacts", ()) if row[0] > at)
        step, contacts = next(rows, (0, {"pairs": (), "distance": ()}))
        for pair, gap in zip(contacts["pairs"], contacts["distance"], strict=True):
            others = [link for link in pair if log.bodies.get(link) == action["body"]]
            if gap >= _NEAR or len(others) != 1 or not ours & set(pair):
                continue
            excused.hits[others[0]] = range(step, step + _HIT_FOR_STEPS)
            excused.texts.append(f"{others[0]} appeared {gap * 1e3:.0f} mm from the robot")
            if gap <= 0.0:
                excused.overlaps = min(excused.overlaps, step)
    for link, (step, when) in touched(log).items():
        if when is None:
            excused.overlaps = min(excused.overlaps, step)
            excused.ran_into.append(link)
            excused.texts.append(f"{link} ran into the base at step {step}")
    return excused


def judge(
    log: SaleLog,
    result: Mapping[str, Any] | None,
    killed: str = "",
    excused: Excuses | None = None,
) -> list[str]:
    """Return every promise that a sale has broken, one sentence each.

    excused: what could not be avoided; None: all could.
    """
    excused = excused or Excuses()
    if result is None:
        return ["there is no result.json"]
    damage = [] if log.is_whole else ["the recording cannot be read to its end"]
    return [
        *damage,
        *_forces(log, excused),
        *_hits(log, excused),
        *_motion(log, result),
        *_sale(log, result),
        *_touches(log, result, excused),
        *_blame(result, killed),
    ]


def largest_force(log: SaleLog) -> float:
    """Return the largest force of the robot on anything but the ground [N]."""
    return max((force for _, _, force in _robot_contacts(log)), default=0.0)


def _robot_contacts(log: SaleLog) -> Iterator[tuple[int, tuple[str, str], float]]:
    """Yield step, pair of links and peak of every touch that no wheel has with the ground."""
    ours = set(log.names.get("plant/contacts", ()))
    for step, row in log.messages.get("plant/contacts", ()):
        for pair, force in zip(row["pairs"], row["peak_force"], strict=True):
            one, other = pair
            rolls = any(link in _ROLLING for link in pair) and any(link in _GROUND for link in pair)
            if force > 0.0 and not rolls and (one in ours or other in ours):
                yield step, (one, other), force


def _forces(log: SaleLog, excused: Excuses) -> Iterator[str]:
    worst: dict[tuple[str, str], tuple[float, int]] = {}
    for step, pair, force in _robot_contacts(log):
        if force > MOST_FORCE and not excused.covers(pair, step):
            worst[pair] = max(worst.get(pair, (0.0, 0)), (force, step))
    for (one, other), (force, step) in worst.items():
        yield f"{one} pressed on {other} with {force:.0f} N at step {step}"


def touched(log: SaleLog) -> dict[str, tuple[int, int | None]]:
    """Return what was in the way and touched: at which step first, and when the base had to brake.

    None: to brake at its limit would not have avoided it.
    """
    first: dict[str, int] = {}
    for step, pair, _ in _robot_contacts(log):
        for link in IN_THE_WAY.keys() & set(pair):
            first.setdefault(link, step)
    speeds = {step: row["vx"] for step, row in log.messages.get("plant/odometry", ())}
    poses, names = log.messages.get("plant/poses", ()), log.names.get("plant/poses", [])
    return {
        link: (step, avoidable(poses, speeds, names, link, step)) for link, step in first.items()
    }


def _hits(log: SaleLog, excused: Excuses) -> Iterator[str]:
    """Check that the base is touched only by what braking at its limit would not have avoided."""
    for link, (step, when) in touched(log).items():
        if when is not None and not excused.covers([link], step):
            yield f"{link} is touched at step {step}; braking at step {when} would have avoided it"


def _motion(log: SaleLog, result: Mapping[str, Any]) -> Iterator[str]:
    """Check that nothing of the robot moves at the end."""
    state, base = log.last("plant/joint_state"), log.last("plant/odometry")
    for name, v in zip(
        log.names.get("plant/joint_state", ()), state.get("velocity", ()), strict=False
    ):
        if abs(v) > _AT_REST:
            yield f"{name} moves at {v:.3f} rad/s at the end: {result['reason']}"
    if abs(base.get("vx", 0.0)) > _AT_REST or abs(base.get("wz", 0.0)) > _AT_REST:
        yield f"the wheels turn at the end, at {base['vx']:.3f} m/s: {result['reason']}"
    rows = log.messages.get("plant/poses", ())[-2:]
    if len(rows) == 2:
        seconds = (rows[1][0] - rows[0][0]) * STEP_S
        chassis = log.names["plant/poses"].index("chassis")
        speed = math.dist(*(row["position"][chassis] for _, row in rows)) / seconds
        if speed > _AT_REST:
            yield f"the chassis moves at {speed:.3f} m/s at the end: {result['reason']}"


def _sale(log: SaleLog, result: Mapping[str, Any]) -> Iterator[str]:
    """Check that an item is in the outlet where the run says so, and only there."""
    sold = [row for text in log.texts() for row in _SOLD.findall(text)]
    if result["exit_code"] == 0 and not sold and "1 of 1" in result["reason"]:
        yield "it says that the order was sold, and its table has no item"
    names = log.names.get("plant/poses", [])
    where = log.last("plant/poses").get("position")
    for item, reported in dict(sold).items():
        unknown = (math.inf, math.inf, math.inf)
        x, y, z = where[names.index(item)] if where and item in names else unknown
        error = math.hypot(x - _OUTLET[0], y - _OUTLET[1])
        if abs(z - _OUTLET[2]) > 0.01 or error > 0.06:
            yield f"it says that {item} is sold; it is at {x:.3f}, {y:.3f}, {z:.3f} m"
        elif abs(error - float(reported) * 1e-3) > _MEASURED:
            yield f"it says that {item} is {reported} mm from its spot; it is {error * 1e3:.1f} mm"


def _touches(log: SaleLog, result: Mapping[str, Any], excused: Excuses) -> Iterator[str]:
    """Check that touches which are reported were there, and that those which were are reported."""
    reports = [*log.texts(), result["reason"]]
    longest, most = defaultdict[frozenset[str], int](int), defaultdict[frozenset[str], float](float)
    for step, pair, force in _robot_contacts(log):
        key = frozenset(pair)
        most[key] = max(most[key], force)
        thrown = step >= excused.overlaps
        longest[key] += force > _WORTH_A_WORD and not thrown
    for text in dict.fromkeys(reports):
        for one, other, force in _TOUCH.findall(text):
            if most[frozenset((one, other))] < 0.5 * float(force):
                yield f"it says {one} touches {other} with {force} N; the log has no such touch"
        yield from _afterwards(log, text)
    for item, far in _MOVED.findall(result["reason"]):
        if not any(item in key for key in most):
            yield f"it says the sale failed for {item}, {far} mm; the robot never touched it"
    ours, links = set(log.names.get("plant/contacts", ())), log.names.get("plant/poses", ())
    # Their names are `<type>_<row>_<number>`.
    items = {name for name in links if re.fullmatch(r"[a-z]+_[ab]\d_\d+", name)}
    for key, steps in longest.items():
        others = [link for link in key if link not in ours]
        is_grip = any(link in _PADS for link in key) and set(others) <= {*items, "outlet_top"}
        is_reported = any(all(link in text for link in key) for text in reports)
        if steps > _FOR_STEPS and not is_grip and not is_reported:
            touched = " and ".join(sorted(key))
            yield f"{touched} touched with {most[key]:.0f} N for {steps} steps, and nothing says so"


def _afterwards(log: SaleLog, text: str) -> Iterator[str]:
    """Check what is reported of two links after the robot has backed off."""
    for one, other, _, force in _STILL.findall(text):
        felt = [f for _, pair, f in _robot_contacts(log) if set(pair) == {one, other}]
        if not any(abs(f - float(force)) < _SAME_FORCE for f in felt):
            yield f"it says {one} still touches {other} with {force} N; the log has no such touch"
    for one, other, _, gap in _APART.findall(text):
        row = log.last("plant/contacts")
        pairs = zip(row.get("pairs", ()), row.get("distance", ()), strict=True)
        now = [distance for pair, distance in pairs if set(pair) == {one, other}]
        if now and abs(now[0] - 1e-3 * float(gap)) > _SAME_GAP:
            yield f"it says {one} is {gap} mm from {other}; it is {now[0] * 1e3:.1f} mm"


def _blame(result: Mapping[str, Any], killed: str) -> Iterator[str]:
    if killed and result["exit_code"] and result["participant"] != killed:
        yield f"{killed} was killed, and it names {result['participant']}: {result['reason']}"
    if not killed and result["exit_code"] and result["participant"] not in {"mission", None}:
        yield f"no participant was killed, and {result['participant']} failed: {result['reason']}"
