import math

import pytest
from support.services.devices import make_stand, write_base

from stepbus_plant.commander import CommandError
from stepbus_plant.engines import default_engine
from stepbus_schemas import BaseCommand, JointCommand, WiringError

WORLD = """
physics_step: 2.5ms
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  robot: {urdf: base.urdf, position: [0, 0, 0.1], joint_defaults: {mode: velocity}}
bases:
  base: {left: left, right: right, wheel_radius: 0.1, track: 0.5}
"""


@pytest.fixture
def stand(tmp_path):
    write_base(tmp_path)
    inputs = {"base": "BaseCommand/1", "joints": "JointCommand/1"}
    outputs = {"odometry": "BaseState/1", "truth": "Poses/1"}
    stand = make_stand(tmp_path, WORLD, outputs, inputs, joints=["left", "right"])
    yield stand
    stand.participant.close()


def ramp(top, seconds):
    """Return velocities at each step that rise for 0.5 s, stay at `top`, and fall."""
    steps = round(seconds * 200)
    return [top * min(1.0, n / 100, (steps - n) / 100) for n in range(steps + 1)] + [0.0] * 40


def drive(stand, commands):
    """Return odometry and true x, y, yaw of the chassis after the last command."""
    for step, command in enumerate(commands):
        stand.update(step, base=command)
        stand.participant.output(None)
    shown = stand.participant.output(None)
    row = stand.participant.describe()["truth"].names.index("chassis")
    (x, y, _), (_, _, qz, qw) = (
        shown["truth"].position[row],
        shown["truth"].orientation[row],
    )
    return shown["odometry"], (x, y, 2 * math.atan2(qz, qw))


def test_a_base_drives_straight_as_its_odometry_says(stand):
    odometry, truth = drive(stand, [BaseCommand(vx=v) for v in ramp(0.5, 3.5)])
    assert odometry.x == pytest.approx(1.5, abs=5e-3)
    # MuJoCo's wheels sink into the floor by 0.3 mm of their 100, and roll on what is left.
    off = 1e-3 if default_engine() == "pybullet" else 5e-3
    assert math.dist((odometry.x, odometry.y), truth[:2]) < off


def test_odometry_follows_an_arc_as_the_base_does(stand):
    odometry, truth = drive(stand, [BaseCommand(vx=v, wz=2 * v) for v in ramp(0.4, 2.5)])
    assert odometry.yaw == pytest.approx(1.6, abs=0.01)
    assert math.dist((odometry.x, odometry.y), truth[:2]) < 5e-3


def test_ports_of_one_base_have_the_same_odometry_whatever_their_number(tmp_path):
    write_base(tmp_path)

    def read(*ports):
        outputs, errors = dict.fromkeys(ports, "BaseState/1"), {"wheel": 0.01, "slip": 0.05}
        inputs = {"base": "BaseCommand/1"}
        stand = make_stand(tmp_path, WORLD, outputs, inputs, odometry=errors)
        for step in range(20):
            stand.update(step, base=BaseCommand(vx=0.5))
            shown = stand.participant.output(None)
        stand.participant.close()
        return [shown[port] for port in ports]

    (alone,) = read("odometry")
    assert read("odometry", "again") == [alone, alone]


def test_wheel_velocities_are_another_way_to_command_a_base(stand):
    odometry, _ = drive(stand, [BaseCommand(wheels=(v, v)) for v in ramp(2.0, 1.5)])
    assert odometry.x == pytest.approx(0.2, abs=2e-3)


@pytest.mark.parametrize("command", [BaseCommand(vx=math.nan), BaseCommand(wheels=(math.nan, 1))])
def test_a_command_that_is_not_finite_is_refused(stand, command):
    with pytest.raises(CommandError, match=r"input 'base': values of joint left is nan"):
        stand.update(0, base=command)


def test_the_wheels_of_a_base_take_no_second_driver(stand):
    stand.update(0, base=BaseCommand(vx=0.1))
    with pytest.raises(CommandError, match="left is already driven by input 'base'"):
        stand.update(1, joints=JointCommand(mode="velocity", values=[1.0, 1.0]))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("left: left,", "left: lefd,", r"world\.yaml:7: bases\.base\.left: joint 'lefd' is unkn"),
        (
            "right: right",
            "right: left",
            r"bases\.base\.right: 'left' is already the joint of 'left'",
        ),
        ("mode: velocity", "mode: torque", r"has mode torque; set it to velocity"),
        ("radius: 0.1", "radius: 0", r"bases\.base\.wheel_radius: "),
    ],
)
def test_a_mistake_in_the_world_is_told_with_its_line(tmp_path, old, new, text):
    write_base(tmp_path)
    with pytest.raises(WiringError, match=text):
        make_stand(tmp_path, WORLD.replace(old, new), {"base": "BaseState/1"}, {})


@pytest.mark.parametrize("brake", [None, 3.0])
def test_a_base_comes_to_rest_in_an_emergency_stop_and_slips_only_with_locked_wheels(
    tmp_path, brake
):
    write_base(tmp_path)
    mode = "mode: velocity" if brake is None else f"mode: velocity, brake: {10 * brake}"
    world = WORLD.replace("mode: velocity", mode)
    outputs = {"odometry": "BaseState/1", "truth": "Poses/1", "stop": "EmergencyStop/1"}
    stand = make_stand(tmp_path, world, outputs, {"base": "BaseCommand/1"})
    rows = []
    for step in range(400):
        if step == 200:
            stand.participant.emergency_stop(by="a test")
        stand.update(step, base=BaseCommand(vx=min(step / 150, 1.0)))
        shown = stand.participant.output(None)
        rows.append((shown["odometry"], shown["truth"].position))
    name = stand.participant.describe()["truth"].names.index("chassis")
    moved = rows[-1][1][name][0] - rows[199][1][name][0]
    by_odometry = rows[-1][0].x - rows[199][0].x
    assert abs(rows[-1][0].vx) < 5e-3
    assert rows[-1][1][name] == pytest.approx(rows[-2][1][name], abs=1e-4)
    if brake is None:
        assert moved > by_odometry + 0.02
    else:
        assert moved == pytest.approx(by_odometry, abs=5e-3)
        assert moved == pytest.approx(1.0 / (2 * brake), abs=0.02)
    stop = stand.participant.plant.stop.state
    assert (stop.active, stop.by, stop.since) == (True, "a test", pytest.approx(1.0))


def test_a_watchdog_brakes_a_base_without_commands_until_the_next_one(tmp_path):
    write_base(tmp_path)
    world = WORLD.replace("mode: velocity", "mode: velocity, brake: 30")
    outputs = {"odometry": "BaseState/1", "events": "Event/1"}
    stand = make_stand(tmp_path, world, outputs, {"base": "BaseCommand/1"}, watchdog="100ms")
    speeds, texts = [], []
    for step in range(300):
        silent = 100 < step < 200
        shown = stand.update(step, **({} if silent else {"base": BaseCommand(vx=0.5)}))
        speeds.append(shown["odometry"].vx)
        texts += [shown["events"].text] if "events" in shown else []
    assert speeds[115] == pytest.approx(0.5, abs=0.01)
    assert max(map(abs, speeds[170:200])) < 5e-3
    assert speeds[280] == pytest.approx(0.5, abs=0.01)
    (text,) = texts
    assert text.startswith("at 0.6 s: no command on input 'base'")


def test_without_a_watchdog_a_command_holds(tmp_path):
    write_base(tmp_path)
    stand = make_stand(tmp_path, WORLD, {"odometry": "BaseState/1"}, {"base": "BaseCommand/1"})
    for step in range(300):
        shown = stand.update(step, **({"base": BaseCommand(vx=0.5)} if step < 100 else {}))
    assert shown["odometry"].vx == pytest.approx(0.5, abs=0.01)
