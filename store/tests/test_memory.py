"""What a participant of the store saves, and what it then has again."""

import functools
import math
from collections import Counter, deque
from pathlib import Path

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from stepbus_participant import Config
from stepbus_schemas import BaseState, RunError
from stepbus_store import memory
from stepbus_store.cause import Cause
from stepbus_store.memory import Remembering
from stepbus_store.motion.base_segments import turn_to
from stepbus_store.motion.joint_motion import JointMotion, MotionLimits, stop_from
from stepbus_store.world_model.world_model import ItemPose


class Thing(Remembering):
    """A participant with objects of every kind; `change` stands for its steps."""

    __module__ = "stepbus_store.memory"

    def __init__(self):
        rest = {"folder": Path(), "inputs": {}, "outputs": {}}
        super().__init__(Config(name="thing", params={}, step_ns=1, every=1, seed=0, **rest))
        self.kept = [1.0, 2.0]
        self.numbers = np.zeros((2, 3))
        self.random = np.random.Generator(np.random.PCG64(1))
        self.goal = self.model = pin.Model()
        self.gone = 1
        self.remember()

    def change(self):
        pose = ItemPose(x=-0.0, y=math.nan, z=1, yaw=0.1)
        limits = MotionLimits.of_one(1.0, 2.0, 3.0)
        now = JointMotion(
            position=np.array([0.1]), velocity=np.array([0.3]), acceleration=np.array([0.0])
        )
        self.numbers[1, 2] = 0.1
        self.random.random(3)
        self.goal = BaseState(x=0.1, y=0.2, yaw=0.3, vx=0.0, wz=0.0)
        self.shared = [pose, pose, self.goal, self.kept]
        self.itself = {"me": self, ("a", 1): {"b", "a"}, "c": Counter("aab")}
        self.last = deque([np.asfortranarray(np.eye(3)[:2]), np.float64(0.1)], maxlen=2)
        self.plan = turn_to(0.5)
        self.way = functools.partial(self.at, 1, by=pin.SE3.Random())
        self.stop = stop_from(now, limits)
        self.rest = iter([1, 2])
        next(self.rest)
        self.cause = Cause.NO_PATH
        self.links = frozenset(("b", "a"))
        del self.gone

    def at(self, *_, **__):
        """Stand for what a partial calls."""


memory.Thing = Thing


@pytest.fixture
def pair():
    """A participant, and one that was restored from its state."""
    one, other = Thing(), Thing()
    one.change()
    other.restore(one.save())
    return one, other


def test_what_has_changed_is_there_again(pair):
    one, other = pair
    assert other.save() == one.save()
    pose = other.shared[0]
    assert pose is other.shared[1]
    assert math.copysign(1.0, pose.x) == -1.0
    assert math.isnan(pose.y)
    assert (type(pose.z), pose.yaw) == (int, 0.1)
    assert other.goal == one.goal
    assert other.goal is other.shared[2]
    assert other.kept is other.shared[3]
    assert other.itself["me"] is other
    assert other.itself["a", 1] == {"a", "b"}
    assert other.itself["c"] == Counter(a=2, b=1)
    assert other.numbers.tolist() == one.numbers.tolist()
    assert other.random.random() == one.random.random()
    assert other.last.maxlen == 2
    assert other.last[0].flags.f_contiguous
    assert isinstance(other.last[1], np.float64)
    assert other.plan(other.goal) == one.plan(one.goal)
    assert other.way.func == other.at
    assert (other.way.keywords["by"].homogeneous == one.way.keywords["by"].homogeneous).all()
    assert other.stop.duration == one.stop.duration
    assert (other.stop.at(0.1).position == one.stop.at(0.1).position).all()
    assert list(other.rest) == [2]
    assert other.cause is Cause.NO_PATH
    assert other.links == {"a", "b"}
    assert not hasattr(other, "gone")


def test_what_has_not_changed_is_no_part_of_a_state():
    assert len(Thing().save()) < 20


def test_an_object_that_cannot_be_saved_is_named_once(capsys):
    thing = Thing()
    thing.rest = (n for n in range(2))
    assert thing.save() is thing.save() is None
    assert capsys.readouterr().err.count("no checkpoint: generator cannot be saved") == 1


def test_a_subclass_of_a_user_saves_nothing():
    class Own(Thing):
        """Has whatever it has."""

    assert Own().save() is None


@pytest.mark.parametrize(
    "name",
    ["os:system", "stepbus_store.memory:importlib.import_module", "stepbus_store.memory:zlib"],
)
def test_a_state_names_nothing_but_our_classes_and_functions(name):
    state = {0: ["object", "stepbus_store.memory:Thing", {"kept": ["enum", name, "true"]}]}
    with pytest.raises(RunError, match="the state names"):
        Thing().restore(memory.zlib.compress(msgspec.msgpack.encode(state)))


@pytest.mark.parametrize(
    ("number", "row", "problem"),
    [
        (1, ["pose", b"", b""], "the state changes a constant"),
        (0, ["object", "a:B", {}], "has a:B in place of stepbus_store.memory:"),
    ],
)
def test_a_state_of_another_program_is_refused(number, row, problem):
    state = {number: row}
    with pytest.raises(RunError, match=problem):
        Thing().restore(memory.zlib.compress(msgspec.msgpack.encode(state)))
