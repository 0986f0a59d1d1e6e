import logging
import math
import re

import numpy as np
import pytest
from support.services.camera import IMAGES, WORLD, make_plant, metres, write_scene
from support.services.control import Stand
from support.services.devices import write_base

from stepbus_plant.engines import default_engine
from stepbus_schemas import BaseCommand, JointCommand, WiringError

WHEEL = "  wheel: {urdf: wheel.urdf, position: [5, 0, 1], fixed_base: true, joint_defaults: {mode: MODE}}\n"
OUTPUTS = {"truth": "Poses/1", "state": "JointState/1", "events": "Event/1"}
COMMANDS = {"torque": 10.0, "velocity": 5.0, "position": 3.0}


def make_stand(folder, *script, world=WORLD, mode="velocity", outputs=OUTPUTS, **params):
    write_scene(folder, world + WHEEL.replace("MODE", mode))
    inputs = {"command": "JointCommand/1"}
    return Stand(make_plant(folder, outputs, inputs, script=list(script), **params))


def run(stand, steps, **commands):
    """Return what is shown at the beginning of each step, and after the last."""
    shown = []
    for step in range(steps):
        shown.append(stand.participant.output(None))
        stand.update(step, **commands)
    return [*shown, stand.participant.output(None)]


def pose(stand, shown, link):
    place = stand.participant.describe()["truth"].names.index(link)
    return shown["truth"].position[place], shown["truth"].orientation[place]


def texts(shown):
    """Return the events, and the steps at which they came."""
    return {n: row["events"].text for n, row in enumerate(shown) if "events" in row}


def test_a_body_is_put_somewhere_before_the_physics_of_the_step(tmp_path):
    put = {"at": "10ms", "body": "crate", "position": [2, 3, 4], "orientation_rpy": [0, 0, 1]}
    stand = make_stand(tmp_path, put)
    shown = run(stand, 3)
    before, after = (pose(stand, shown[step], "crate") for step in (2, 3))
    assert before[0] == pytest.approx((0.1, 0.05, 0.05))
    assert after[0] == pytest.approx((2, 3, 4))
    assert after[1] == pytest.approx((0, 0, math.sin(0.5), math.cos(0.5)))
    assert texts(shown)[3].startswith("at 0.01 s: crate was put at 2, 3, 4 m")
    assert shown[3]["events"].level == "info"


def test_a_falling_body_is_at_rest_where_it_is_put_and_keeps_its_orientation(tmp_path):
    put = {"at": "50ms", "body": "crate", "position": [2, 3, 4]}
    falling = WORLD.replace("0.05], fixed_base: true", "3], orientation_rpy: [0, 0.3, 0]")
    stand = make_stand(tmp_path, put, world=falling)
    shown = run(stand, 11)
    position, orientation = pose(stand, shown[11], "crate")
    # One step of free fall from rest: 9.81 m/s² · (5 ms)².
    assert position == pytest.approx((2, 3, 4 - 9.81 * 0.005**2), abs=1e-6)
    assert orientation == pytest.approx(pose(stand, shown[0], "crate")[1], abs=1e-6)


def test_a_camera_and_other_bodies_notice_where_a_fixed_body_was_put(tmp_path):
    put = {"at": "0s", "body": "crate", "position": [0, 0, 0.3]}
    stand = make_stand(tmp_path, put, outputs=IMAGES)
    shown = run(stand, 2)
    assert metres(shown[0]["depth"])[119, 159] == pytest.approx(1.0, abs=1e-4)
    assert metres(shown[2]["depth"])[119, 159] == pytest.approx(0.65, abs=1e-4)


@pytest.mark.parametrize("sleeping", ["false", "true"])
def test_what_stood_on_a_body_falls_when_it_is_put_away(tmp_path, sleeping):
    on_top = "  can: {urdf: crate.urdf, position: [0.1, 0.05, 0.151]}\n"
    put = {"at": "2.5s", "body": "crate", "position": [9, 9, 9]}
    world = f"sleeping: {sleeping}\n{WORLD}{on_top}"
    stand = make_stand(tmp_path, put, world=world)
    shown = run(stand, 540)
    assert pose(stand, shown[500], "can/crate")[0][2] == pytest.approx(0.15, abs=2e-3)
    assert pose(stand, shown[540], "can/crate")[0][2] < 0.1


@pytest.mark.parametrize("sleeping", ["false", "true"])
def test_a_body_that_is_put_into_the_air_falls(tmp_path, sleeping):
    put = {"at": "2.5s", "body": "crate", "position": [0.1, 0.05, 0.5]}
    loose = WORLD.replace("0.05], fixed_base: true", "0.05]")
    stand = make_stand(tmp_path, put, world=f"sleeping: {sleeping}\n{loose}")
    shown = run(stand, 540)
    assert pose(stand, shown[501], "crate")[0][2] == pytest.approx(0.5, abs=1e-3)
    assert pose(stand, shown[540], "crate")[0][2] < 0.4


@pytest.mark.parametrize("mode", COMMANDS)
def test_a_jammed_joint_stands_still_whatever_it_is_commanded(tmp_path, mode):
    stand = make_stand(tmp_path, {"at": "100ms", "jam": "axle"}, mode=mode)
    command = JointCommand(mode=mode, values=[COMMANDS[mode]])
    shown = run(stand, 80, command=command)
    positions = [row["state"].position[0] for row in shown]
    assert positions[20] > 0.1
    np.testing.assert_allclose(positions[21:], positions[20], rtol=2e-5)
    assert texts(shown) == {21: f"at 0.1 s: joint axle jammed at {positions[20]:.6g} rad"}


def test_a_base_with_a_jammed_wheel_turns_about_it(tmp_path):
    write_base(tmp_path)
    world = """
bases: {base: {left: left, right: right, wheel_radius: 0.1, track: 0.5}}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  base: {urdf: base.urdf, position: [0, 0, 0.1], joint_defaults: {mode: velocity}}
"""
    (tmp_path / "world.yaml").write_text(world)
    participant = make_plant(
        tmp_path,
        {"odometry": "BaseState/1", "state": "JointState/1"},
        {"base": "BaseCommand/1"},
        script=[{"at": "1s", "jam": "left"}],
    )
    shown = run(Stand(participant), 400, base=BaseCommand(vx=0.3))
    wheel = [row["state"].position[0] for row in shown]
    assert abs(shown[200]["odometry"].yaw) < 0.01
    assert shown[400]["odometry"].yaw > 0.3
    assert max(abs(angle - wheel[200]) for angle in wheel[200:]) < 0.03
    assert abs(wheel[400] - wheel[200]) < 0.003


def test_a_camera_that_fails_gives_no_images_until_it_is_on_again(tmp_path):
    script = [
        {"at": "10ms", "camera": "wrist"},
        {"at": "30ms", "camera": "wrist", "off": False},
    ]
    shown = run(make_stand(tmp_path, *script, outputs={**IMAGES, **OUTPUTS}), 10)
    assert [n for n, row in enumerate(shown) if "rgb" in row] == [0, 2, 8, 10]
    events = texts(shown)
    assert (events[3][-12:], events[7][-11:]) == ("switched off", "switched on")


def test_a_script_does_not_switch_on_what_the_scenario_switches_off(tmp_path):
    on = {"at": "10ms", "camera": "wrist", "off": False}
    shown = run(make_stand(tmp_path, on, outputs=IMAGES, cameras=False), 6)
    assert shown == [{}] * 7


def test_a_time_between_two_steps_is_that_of_the_next_step(tmp_path):
    between = [
        {"at": "11ms", "camera": "wrist"},
        {"at": "6ms", "jam": "axle"},
        {"at": "1s", "camera": "wrist"},
    ]
    shown = run(make_stand(tmp_path, *between), 5)
    events = texts(shown)
    assert events[3].startswith("at 0.01 s: joint axle jammed")
    assert events[4].startswith("at 0.015 s: camera wrist")


def test_actions_of_the_same_time_happen_in_their_order(tmp_path):
    script = [
        {"at": "5ms", "body": "crate", "position": [1, 1, 1]},
        {"at": "5ms", "body": "crate", "position": [2, 2, 2]},
    ]
    stand = make_stand(tmp_path, *script)
    shown = run(stand, 2)
    assert pose(stand, shown[2], "crate")[0] == pytest.approx((2, 2, 2))
    assert texts(shown)[2].splitlines() == [
        "at 0.005 s: crate was put at 1, 1, 1 m",
        "at 0.005 s: crate was put at 2, 2, 2 m",
    ]


def test_warnings_and_what_happened_share_one_event(tmp_path):
    stand = make_stand(tmp_path, {"at": "0s", "jam": "axle"})
    shown = run(stand, 1, command=JointCommand(mode="velocity", values=[99.0]))
    assert shown[1]["events"].level == "warning"
    first, second = shown[1]["events"].text.splitlines()
    assert first.startswith("step 0: joint axle: 99 rad/s")
    assert second == "at 0 s: joint axle jammed at 0 rad"


def test_without_a_port_for_events_the_log_tells_what_happened(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    run(make_stand(tmp_path, {"at": "0s", "jam": "axle"}, outputs=IMAGES), 1)
    assert "at 0 s: joint axle jammed at 0 rad" in caplog.text


UNKNOWN = [
    (
        {"body": "crat", "position": [0, 0, 0]},
        "body: body 'crat' is unknown; did you mean 'crate'?",
    ),
    ({"jam": "axel"}, "jam: joint 'axel' is unknown; did you mean 'axle'?"),
    ({"jam": "mount"}, "jam: joint 'mount' is fixed in its model"),
    ({"camera": "wirst"}, "camera: camera 'wirst' is unknown; did you mean 'wrist'?"),
]


def test_unknown_names_are_all_listed_before_the_run(tmp_path):
    with pytest.raises(WiringError) as caught:
        make_stand(tmp_path, *({"at": "1s", **action} for action, _ in UNKNOWN))
    assert str(caught.value).splitlines() == [
        f"participants.plant.params.script[{number}].{text}"
        for number, (_, text) in enumerate(UNKNOWN)
    ]


MISTAKES = [
    ({"jam": "axle"}, ": the key 'at' is missing"),
    ({"at": "1s"}, ": needs exactly one of body, push, jam, camera, emergency_stop; it has none"),
    (
        {"at": "1s", "jam": "axle", "camera": "wrist"},
        ": needs exactly one of body, push, jam, camera, emergency_stop; it has jam and camera",
    ),
    ({"at": "1s", "body": "crate"}, ": needs either 'position' or 'to'"),
    ({"at": "1s", "body": "crate", "to": [1, 2, 3]}, ": 'to' and 'over' must be given together"),
    (
        {"at": "0.5ns", "jam": "axle"},
        ".at: '0.5ns' is 0.5 ns, not a whole number of nanoseconds; the nearest is 1ns",
    ),
    ({"at": "1s", "jma": "axle"}, ".jma: unknown key 'jma'; did you mean 'jam'?"),
    ({"at": 1, "jam": "axle"}, ".at: must be a duration with a unit, e.g. 5ms, not 1"),
    ("jam", ": must be a map, not 'jam'"),
]


def test_mistakes_in_a_script_are_all_listed_before_the_run(tmp_path):
    with pytest.raises(WiringError) as caught:
        make_stand(tmp_path, *(action for action, _ in MISTAKES))
    assert sorted(str(caught.value).splitlines()) == sorted(
        f"participants.plant.params.script[{number}]{text}"
        for number, (_, text) in enumerate(MISTAKES)
    )


def test_a_script_stops_the_plant_and_releases_it(tmp_path):
    actions = [{"at": "100ms", "emergency_stop": True}, {"at": "200ms", "emergency_stop": False}]
    outputs = {**OUTPUTS, "stop": "EmergencyStop/1"}
    stand = make_stand(tmp_path, *actions, mode="velocity", outputs=outputs)
    shown = run(stand, 80, command=JointCommand(mode="velocity", values=[1.0]))
    speeds = [row["state"].velocity[0] for row in shown]
    assert min(speeds[10:20]) > 0.5
    assert max(map(abs, speeds[25:40])) < 1e-3
    assert min(speeds[60:]) > 0.5
    stops = [(row["stop"].active, row["stop"].by, row["stop"].since) for row in shown]
    assert stops == [
        *[(False, "", 0.0)] * 21,
        *[(True, "the script", 0.1)] * 20,
        *[(False, "the script", 0.2)] * 40,
    ]
    first, second = texts(shown).values()
    assert first == "at 0.1 s: emergency stop by the script"
    assert second.startswith("at 0.2 s: emergency stop released")


CAN = "  can: {urdf: crate.urdf, position: [0.4, 0.05, 0.051]}\n"


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("dynamics", ["on", "off"])
def test_a_body_moves_evenly_to_where_it_is_sent(tmp_path, fixed, dynamics):
    send = {
        "at": "100ms", "body": "crate", "to": [1.1, 0.05, 0.05], "over": "500ms",
        "orientation_rpy": [0, 0, 1],
    }  # fmt: skip
    world = WORLD if fixed else WORLD.replace("0.05], fixed_base: true", "0.05]")
    mode = {"mode": "position"} if dynamics == "off" else {}
    stand = make_stand(tmp_path, send, world=world, dynamics=dynamics, **mode)
    shown = run(stand, 160)
    places = [pose(stand, row, "crate") for row in shown]
    assert places[20][0][0] == pytest.approx(0.1, abs=1e-3)
    # 2 m/s and 2 rad/s.
    for step in (40, 60, 80, 100):
        (x, y, _), (_, _, qz, qw) = places[step]
        assert x == pytest.approx(0.1 + 2.0 * (step - 20) * 0.005, abs=0.011)
        assert y == pytest.approx(0.05, abs=2e-3)
        assert 2 * math.atan2(qz, qw) == pytest.approx(2.0 * (step - 20) * 0.005, abs=0.011)
    assert places[121][0] == pytest.approx((1.1, 0.05, 0.05), abs=3e-3)
    assert texts(shown)[21].endswith("1.1, 0.05, 0.05 m in 500ms")


def test_a_body_that_moves_pushes_at_its_velocity_and_its_blow_is_told(tmp_path):
    send = {"at": "100ms", "body": "crate", "to": [0.6, 0.05, 0.05], "over": "1s"}
    outputs = {**OUTPUTS, "touch": "Contacts/1"}
    world = WORLD.replace("bodies:", "contacts: {touch: {links: [can/crate]}}\nbodies:", 1) + CAN
    stand = make_stand(tmp_path, send, world=world, outputs=outputs)
    shown = run(stand, 260)
    places = [pose(stand, row, "can/crate")[0][0] for row in shown]
    speeds = np.diff(places) / 0.005
    # A quick push, and no jump: it leaves as fast as it was hit, or up to twice as fast.
    assert 0.4 < speeds.max() < 1.1
    (hit,) = [text for text in texts(shown).values() if " hits " in text]
    force = float(hit.split(" with ")[1].removesuffix(" N"))
    touches = [row["touch"] for row in shown if ("can/crate", "crate/crate") in row["touch"].pairs]
    peaks = [t.peak_force[t.pairs.index(("can/crate", "crate/crate"))] for t in touches]
    if default_engine() == "pybullet":
        # MuJoCo's contacts do not know how fast a body comes that is moved; they grow as it enters.
        assert force > 50.0
        assert min(abs(peak - force) for peak in peaks) < 0.51
    assert max(peaks) > 5.0
    assert ": crate/crate hits can/crate with " in hit


def test_a_body_that_is_put_into_another_one_is_told(tmp_path):
    put = {"at": "500ms", "body": "crate", "position": [0.45, 0.05, 0.05]}
    stand = make_stand(tmp_path, put, world=WORLD + CAN)
    said = texts(run(stand, 110))[101]
    assert re.search(r"0\.05 m, \d+ mm into can/crate$", said)


def test_a_run_with_a_script_repeats_to_the_byte(tmp_path):
    script = [
        {"at": "20ms", "body": "crate", "position": [0, 0, 0.1], "orientation_rpy": [0.1, 0, 0]},
        {"at": "40ms", "jam": "axle"},
        {"at": "60ms", "body": "crate", "to": [0.2, 0, 0.2], "over": "50ms"},
    ]
    free = WORLD.replace("0.05], fixed_base: true", "0.05]")
    command = JointCommand(mode="velocity", values=[5.0])
    first, second = (
        run(
            make_stand(tmp_path, *script, world=free, outputs={**OUTPUTS, **IMAGES}),
            30,
            command=command,
        )
        for _ in range(2)
    )
    assert first == second
