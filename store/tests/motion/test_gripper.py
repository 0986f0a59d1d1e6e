"""Goals of type grip on a gripper of which every state is written down here."""

from pathlib import Path

import pytest

from stepbus_schemas import Goal, GripperState
from stepbus_store.motion.gripper import Gripper
from stepbus_store.motion.mobile import Params
from stepbus_store.motion.outcome import Refused

DT = 0.008


class Hand:
    """A gripper that closes at 0.1 m/s around a thing of a given width, or around nothing."""

    def __init__(self, width=0.1, thing=None, is_dead=False, grip=None):
        self.grip = grip or Gripper(Params(model=Path(), joints=()))
        self.slip, self.load = 0.0, 0.0
        self.width, self.thing, self.is_dead, self.t = width, thing, is_dead, 0.0
        self.grip.hold(self.state())

    def state(self):
        holding = self.thing is not None and self.width <= self.thing
        force = 15.0 * holding
        return GripperState(width=self.width, force=force, holding=holding, slip=self.slip)

    def step(self):
        """Move on by a step; returns the outcome and what was said to be lost."""
        self.t += DT
        least = self.thing or 0.0
        gap = self.grip.command().width - self.width
        if not self.is_dead:
            self.width = max(self.width + min(max(gap, -0.1 * DT), 0.1 * DT), least)
        outcome = self.grip.check(self.state(), self.t)
        self.grip.secure(self.load)
        return outcome, self.grip.lost(self.t)

    def go(self, width, force=15.0, seconds=3.0):
        """Return the outcome of a goal; None: there was none in time."""
        self.grip.start(Goal(id=0, type="grip", width=width, force=force), self.t)
        for _ in range(round(seconds / DT)):
            outcome, _ = self.step()
            if outcome is not None:
                return outcome
        return None


def test_closing_on_a_can_ends_held_with_its_width_and_the_force():
    hand = Hand(thing=0.066)
    outcome = hand.go(0.0)
    assert (outcome.state, outcome.text) == ("succeeded", "held: 66.0 mm wide, 15.0 N")
    assert hand.t == pytest.approx(0.34 + 0.1, abs=0.02)


def test_what_slips_is_gripped_harder_until_it_holds_and_no_harder_than_the_goal_allows():
    hand, forces = Hand(thing=0.066), []
    hand.go(0.0)
    for slip in (0.0, 0.00005, 0.0002, 0.0004, 0.0004, 0.0004):
        hand.slip = slip
        hand.step()
        forces.append(hand.grip.command().force)
    assert forces == pytest.approx([6.0, 6.0, 7.5, 9.375, 9.375, 9.375])
    for _ in range(20):
        hand.slip += 0.001
        hand.step()
    assert hand.grip.command().force == 15.0


def test_the_force_grows_with_the_weight_and_does_not_shrink_before_it_is_let_go():
    hand = Hand(thing=0.066)
    hand.go(0.0)
    for hand.load, force in ((0.1, 6.0), (0.5, 9.2), (0.2, 9.2), (3.0, 15.0)):
        hand.step()
        assert hand.grip.command().force == pytest.approx(force, abs=0.01)
    hand.go(0.09)
    assert hand.go(0.0).state == "succeeded"
    assert hand.grip.command().force == pytest.approx(15.0)
    hand.load = 0.0
    hand.go(0.09)
    hand.go(0.0)
    assert hand.grip.command().force == 6.0


def test_closing_on_nothing_ends_at_the_width_and_says_so():
    outcome = Hand().go(0.02)
    assert (outcome.state, outcome.text) == ("succeeded", "20.0 mm wide, holds nothing")


def test_a_hand_that_does_not_move_is_stuck():
    outcome = Hand(is_dead=True).go(0.0)
    assert (outcome.state, outcome.cause) == ("failed", "stuck")
    assert "moved: 100.0 mm wide instead of 0.0 mm" in outcome.text


def test_a_hand_that_does_not_let_go_is_stuck_and_has_not_held():
    hand = Hand(thing=0.066)
    hand.go(0.0)
    hand.is_dead = True
    outcome = hand.go(0.09)
    assert (outcome.state, outcome.cause) == ("failed", "stuck")
    told = "66.0 mm wide instead of 90.0 mm, 15.0 N of 15.0 N, something between them"
    assert f"have not moved: {told}: is one finger jammed?" in outcome.text


@pytest.mark.parametrize("is_dead", [True, False])
def test_fingers_that_lose_something_and_do_not_close_may_be_jammed(is_dead):
    hand = Hand(thing=0.066)
    hand.go(0.0)
    hand.is_dead, hand.thing = is_dead, None
    (said,) = [lost for _, lost in (hand.step() for _ in range(100)) if lost]
    assert said.endswith("is one finger jammed?") is is_dead


def test_a_hand_that_something_blocks_without_being_held_is_stuck():
    hand = Hand(thing=0.04)
    hand.state = lambda: GripperState(width=hand.width, force=0.0, holding=False)
    outcome = hand.go(0.0)
    assert outcome.cause == "stuck"
    assert "stopped after 60.0 mm" in outcome.text


@pytest.mark.parametrize(
    ("width", "force", "cause"),
    [(0.05, 0.0, "invalid"), (0.05, -1.0, "invalid"), (0.2, 5.0, "invalid"),
     (float("nan"), 5.0, "invalid"), (0.05, float("nan"), "invalid")],
)  # fmt: skip
def test_a_grip_without_sense_is_refused(width, force, cause):
    with pytest.raises(Refused) as caught:
        Hand().go(width, force)
    assert caught.value.cause == cause


def test_what_slips_out_is_told_once():
    hand = Hand(thing=0.066)
    hand.go(0.0)
    assert hand.grip.holds
    hand.thing = None
    said = [lost for _, lost in (hand.step() for _ in range(100)) if lost]
    assert len(said) == 1
    assert "held at 66.0 mm is lost" in said[0]
    assert not hand.grip.holds


def test_a_contact_that_flickers_is_not_lost():
    hand = Hand(thing=0.066)
    hand.go(0.0)
    for k in range(100):
        loose = GripperState(width=0.066, force=0.0, holding=k % 10 == 0)
        hand.grip.check(loose, hand.t + k * DT)
        assert hand.grip.lost(hand.t + k * DT) == ""


def test_a_stop_leaves_the_fingers_where_they_are_but_keeps_what_is_held():
    hand = Hand()
    hand.go(0.0, seconds=0.4)
    hand.grip.stop()
    assert hand.grip.command().width == pytest.approx(0.06, abs=1e-3)
    holder = Hand(thing=0.066)
    holder.go(0.0)
    holder.grip.stop()
    assert holder.grip.command().width == 0.0
