import pytest
from support.services.control import STEP_NS
from support.services.devices import make_stand, write_can, write_ground

from stepbus_plant.engines import default_engine
from stepbus_schemas import WiringError

WORLD = """
contacts:
  touch: {}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  one: {urdf: can.urdf, position: [1, 2, HEIGHT]}
  two: {urdf: can.urdf, position: [-1, 0, 0.0575]}
"""
WEIGHT = 0.35 * 9.81


def settle(folder, *, height="0.0575", touch="{}", steps=100):
    """Return the contacts of two cans on the ground; height: of the middle of the first [m]."""
    write_ground(folder)
    write_can(folder)
    world = WORLD.replace("HEIGHT", height).replace("touch: {}", f"touch: {touch}")
    stand = make_stand(folder, world, {"touch": "Contacts/1"}, {})
    for step in range(steps):
        stand.update(step)
    return stand.participant.output(None)["touch"]


def test_a_can_that_stands_presses_with_its_weight(tmp_path):
    contacts = settle(tmp_path)
    assert contacts.pairs == [("floor", "one/can"), ("floor", "two/can")]
    assert contacts.force == pytest.approx([WEIGHT, WEIGHT], rel=0.01)
    assert contacts.distance == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_contact_is_told_where_it_is(tmp_path):
    contacts = settle(tmp_path)
    x, y, z = contacts.position[0]
    assert ((x - 1) ** 2 + (y - 2) ** 2) ** 0.5 == pytest.approx(0.033, abs=2e-3)
    assert z == pytest.approx(0.0, abs=1e-3)


def test_what_is_near_is_shown_without_force(tmp_path):
    contacts = settle(tmp_path, height="0.0875", touch="{links: [one/can], within: 0.05}", steps=1)
    assert (contacts.pairs, contacts.force) == ([("floor", "one/can")], [0.0])
    # PyBullet keeps shapes about 1 mm apart, and tells how far these margins are.
    assert contacts.distance[0] == pytest.approx(0.03, abs=1.5e-3)
    assert contacts.position[0][2] == pytest.approx(0.03, abs=1.5e-3)


def test_all_links_of_a_body_are_asked_for_at_once(tmp_path):
    contacts = settle(tmp_path, touch="{links: [two/*]}", steps=20)
    assert contacts.pairs == [("floor", "two/can")]


def test_two_links_that_are_asked_for_share_a_contact_once(tmp_path):
    contacts = settle(tmp_path, touch="{links: [one/*, two/*, floor]}")
    assert contacts.pairs == [("floor", "one/can"), ("floor", "two/can")]
    assert contacts.force == pytest.approx([WEIGHT, WEIGHT], rel=0.01)


def test_a_can_that_falls_is_near_from_the_right_step_on(tmp_path):
    write_ground(tmp_path)
    write_can(tmp_path)
    world = WORLD.replace("HEIGHT", "1").replace("{}", "{links: [one/can], within: 0.05}", 1)
    stand = make_stand(tmp_path, world, {"touch": "Contacts/1", "truth": "Poses/1"}, {})
    row = stand.participant.describe()["truth"].names.index("one/can")
    gaps, shown = [], []
    for step in range(86):
        stand.update(step)
        output = stand.participant.output(None)
        gaps.append(output["truth"].position[row][2] - 0.0575)
        shown.append(bool(output["touch"].pairs))
    assert min(gaps) < 0.05 < max(gaps)
    # PyBullet's margins make it 1 mm nearer.
    assert shown == [gap - 1e-3 < 0.05 for gap in gaps]


def test_nearness_to_everything_is_refused(tmp_path):
    with pytest.raises(WiringError, match=r"contacts\.touch\.within: needs 'links'"):
        settle(tmp_path, touch="{within: 0.05}")


def test_an_unknown_link_is_refused_with_its_line(tmp_path):
    text = r"world\.yaml:3: contacts\.touch\.links\[0\]: link 'two/cab' is unknown; .*'two/can'"
    with pytest.raises(WiringError, match=text):
        settle(tmp_path, touch="{links: [two/cab]}")


def falls(folder, read_every, until_s=0.6):
    """Return what the floor bore of a can that falls from 0.3 m, read every so many steps."""
    write_ground(folder)
    write_can(folder)
    world = WORLD.replace("HEIGHT", "0.3575").replace("touch: {}", "touch: {links: [one/can]}")
    stand = make_stand(folder, world, {"touch": "Contacts/1"}, {})
    plant, rows = stand.participant.plant, []
    for step in range(round(until_s * 1e9 / STEP_NS)):
        plant.advance()
        if step % read_every == read_every - 1:
            contacts = stand.participant.output(None)["touch"]
            rows += zip(
                contacts.force,
                contacts.peak_force,
                contacts.impulse,
                contacts.distance,
                strict=True,
            )
    return rows, plant.t_ns * 1e-9


def test_an_impulse_is_what_stopped_the_fall(tmp_path):
    rows, seconds = falls(tmp_path, 1)
    assert sum(impulse for _, _, impulse, _ in rows) == pytest.approx(WEIGHT * seconds, rel=5e-3)


def test_a_blow_between_two_readings_is_in_the_log(tmp_path):
    every, _ = falls(tmp_path, 1)
    seldom, seconds = falls(tmp_path, 30)
    peak = max(row[1] for row in every)
    # It hits the floor at 2.4 m/s, and once it is read it stands. MuJoCo's contact is a critically
    # damped spring of 10 ms: v / 10 ms, spread over its way.
    assert peak > (40.0 if default_engine() == "pybullet" else 10.0) * WEIGHT
    assert max(row[0] for row in seldom) < 2.0 * WEIGHT
    assert max(row[1] for row in seldom) == peak
    assert sum(row[2] for row in seldom) == pytest.approx(WEIGHT * seconds, rel=5e-3)


def test_links_that_touched_and_parted_are_reported(tmp_path):
    write_ground(tmp_path)
    write_can(tmp_path)
    world = WORLD.replace("HEIGHT", "0.0575").replace("touch: {}", "touch: {links: [one/can]}")
    stand = make_stand(tmp_path, world, {"touch": "Contacts/1"}, {})
    for _ in range(20):
        stand.participant.plant.advance()
    stand.participant.output(None)
    stand.participant.plant.advance()
    stand.participant.plant.script.move(0, "one", (5.0, 5.0, 2.0), None)
    stand.participant.plant.advance()
    touch = stand.participant.output(None)["touch"]
    assert (touch.pairs, touch.force) == ([("floor", "one/can")], [0.0])
    assert touch.peak_force == pytest.approx([WEIGHT], rel=0.05)
    stand.participant.plant.advance()
    assert stand.participant.output(None)["touch"].pairs == []
