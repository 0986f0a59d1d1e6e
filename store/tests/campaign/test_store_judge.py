"""The judge of the store's part of the campaign finds each promise that is broken."""

import io
from unittest.mock import Mock

import msgpack
import pytest
from campaign.log_reader import parse
from campaign.store.braking import STEP_S
from campaign.store.cases import cases
from campaign.store.judge import SaleLog, decoded, excuses, judge, largest_force, touched
from campaign.store.test_sales import sell
from mcap.writer import Writer

ROBOT = ["chassis", "forearm_link", "left_pad", "right_pad", "left_wheel_link"]
LINKS = ["floor", "chassis", "cola_a1_1", "outlet_top"]
SOLD = {"exit_code": 0, "participant": "mission", "reason": "mission: 1 of 1 sales are done"}
TABLE = "sale  item       attempts  detection  place   others  duration\n1     cola_a1_1  1         0.6 mm     2.0 mm  0.0 mm  39.9 s"


def log(*touches, place=(0.152, 0.65, 0.35), chassis=(0.0, 0.0), velocity=0.0, texts=(TABLE,)):
    """Return the log of a sale; touches: pair and force, four steps each; chassis: x at the end."""
    found = SaleLog()
    found.names = {"plant/contacts": ROBOT, "plant/poses": LINKS, "plant/joint_state": ["elbow"]}
    grip = (("cola_a1_1", "left_pad"), 15.0)
    rows = [(("floor", "left_wheel_link"), 500.0), grip, *touches]
    contacts = {
        "pairs": [list(pair) for pair, _ in rows],
        "peak_force": [force for _, force in rows],
    }
    found.messages["plant/contacts"] = [(step, contacts) for step in range(4)]
    found.messages["plant/joint_state"] = [(9, {"velocity": [velocity]})]
    found.messages["plant/odometry"] = [(9, {"vx": 0.0, "wz": 0.0})]
    found.messages["plant/poses"] = [
        (3 * k, {"position": [(0, 0, 0), (x, 0, 0), place, (0, 0, 0)]})
        for k, x in enumerate(chassis)
    ]
    found.messages["mission/events"] = [(9, {"text": text}) for text in texts]
    return found


def test_a_run_without_a_single_message_is_judged_too():
    lost = "it says that cola_a1_1 is sold; it is at inf, inf, inf m"
    assert judge(SaleLog(), {**SOLD, "exit_code": 6, "reason": "it died"}) == []
    found = SaleLog()
    found.messages["mission/events"] = [(9, {"text": TABLE})]
    assert judge(found, SOLD) == [lost]


def test_a_sale_that_keeps_all_promises_breaks_none():
    assert judge(log(), SOLD) == []
    assert largest_force(log()) == 15.0


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (log((("chassis", "crate"), 60.0)), "chassis pressed on crate with 60 N at step 3"),
        (log((("crate", "forearm_link"), 6.0)), "crate and forearm_link touched with 6 N for 4 st"),
        (log(velocity=0.1), "elbow moves at 0.100 rad/s at the end"),
        (log(chassis=(0.0, 0.01)), "the chassis moves at 0.208 m/s at the end"),
        (log(place=(0.15, 0.65, 0.10)), "it says that cola_a1_1 is sold; it is at 0.150, 0.650, 0"),
        (log(place=(0.17, 0.65, 0.35)), "it says that cola_a1_1 is 2.0 mm from its spot; it is 20"),
        (log(texts=()), "it says that the order was sold, and its table has no item"),
        (
            log(texts=(TABLE, "chassis touches crate_box with 80.0 N; stopped")),
            "it says chassis touches crate_box with 80.0 N; the log has no such touch",
        ),
    ],
)
def test_each_broken_promise_is_found(found, text):
    assert any(line.startswith(text) for line in judge(found, SOLD)), judge(found, SOLD)


def test_a_touch_that_is_reported_is_no_secret():
    text = "chassis touches crate with 6.0 N; stopped, backed off 50 mm by odometry"
    assert judge(log((("chassis", "crate"), 6.0), texts=(TABLE, text)), SOLD) == []


@pytest.mark.parametrize(
    ("end", "force", "gap", "broken"),
    [
        ("still touches it with 6.0 N", 6.0, 0.0, 0),
        ("still touches it with 2.0 N", 6.0, 0.0, 1),
        ("now 50.2 mm from it", 6.0, 0.0505, 0),
        ("now 50.2 mm from it", 6.0, 0.02, 1),
    ],
)
def test_what_is_reported_after_a_touch_is_as_in_the_log(end, force, gap, broken):
    text = f"chassis touches crate with 6.0 N; stopped, backed off 3 mm by odometry, {end}; rest"
    found = log((("chassis", "crate"), force), texts=(TABLE, text))
    row = {"pairs": [["chassis", "crate"]], "peak_force": [0.0], "distance": [gap]}
    found.messages["plant/contacts"].append((9, row))
    assert len(judge(found, SOLD)) == broken, judge(found, SOLD)


def test_a_sale_must_not_fail_for_what_others_moved():
    failed = {**SOLD, "exit_code": 4, "reason": "mission: soup_a1_4 was moved by 18.5 mm"}
    (line,) = judge(log(texts=()), failed)
    assert "soup_a1_4, 18.5 mm" in line


def test_who_was_killed_is_to_be_named():
    failed = {"exit_code": 5, "participant": "plant", "reason": "plant died"}
    (line,) = judge(log(texts=()), failed, killed="planner")
    assert line.startswith("planner was killed, and it names plant")
    assert judge(log(texts=()), {**failed, "participant": "planner"}, killed="planner") == []


def test_the_cases_of_a_seed_are_the_same_each_time_and_have_every_family():
    rows = cases(3, 200)
    assert list(map(str, rows)) == list(map(str, cases(3, 200)))
    assert len({case.family for case in rows}) == 20
    assert sum(case.scenario == "store" for case in rows) == 47
    jams = {case.script[0]["jam"] for case in rows if case.family == "jammed joint"}
    assert len(jams) == 10
    assert {word for case in rows for word in case.arguments()} >= {"--fault", "--in-process"}


def test_a_recording_that_was_cut_is_read_as_far_as_it_goes():
    file = io.BytesIO()
    writer = Writer(file, chunk_size=64)
    writer.start()
    channel = writer.register_channel("plant/odometry", "msgpack", 0)
    for step in range(50):
        row = msgpack.packb({"vx": 0.1 * step, "wz": 0.0})
        writer.add_message(channel, step, row, step, step)
    writer.finish()
    data = file.getvalue()
    whole, cut = (decoded(parse(part)) for part in (data, data[: len(data) // 2]))
    assert whole.is_whole
    assert not cut.is_whole
    assert 1 < len(cut.messages["plant/odometry"]) < 50
    assert "the recording cannot be read to its end" in judge(cut, SOLD)


def test_a_camera_is_given_time_to_start_its_world_model(monkeypatch, tmp_path):
    commands = []

    def run(command, **_):
        commands.append(command)
        return Mock(stderr="", stdout="", returncode=1)

    monkeypatch.setattr("campaign.store.test_sales.subprocess.run", run)
    rows = {case.family: case for case in cases(1, 20)}
    for family in ("somebody crosses", "blocked camera"):
        sell(rows[family], tmp_path)
    timed = [sum("world.spawn_timeout" in word for word in command) for command in commands]
    assert timed == [0, 1]


def meeting(speed, *, starts=0, walks=0.0, far=1.0):
    """Return the log of a base and a crate that touch; both come closer along x [m/s, m].

    The crate is put there, or starts to walk, at a step.
    """
    found = SaleLog()
    found.names = {"plant/contacts": ["chassis"], "plant/poses": ["chassis", "crate_box"]}
    turned = [[0.0, 0.0, 0.0, 1.0]] * 2
    for step in range(300):
        base = speed * STEP_S * step
        crate = far - walks * STEP_S * max(step - starts, 0) if step >= starts or walks else -9.0
        poses = {"position": [[base, 0.0, 0.0], [crate, 0.0, 0.0]], "orientation": turned}
        found.messages["plant/poses"].append((step, poses))
        found.messages["plant/odometry"].append((step, {"vx": speed}))
        force = 90.0 if -9.0 < crate - base <= 0.31 + 0.15 else 0.0
        touch = {"pairs": [["chassis", "crate_box"]], "peak_force": [force], "distance": [0.5]}
        found.messages["plant/contacts"].append((step, touch))
    return found


def test_what_braking_would_have_avoided_is_told_from_what_it_would_not():
    # A base that drives on towards what it has seen for long enough.
    ((step, when),) = touched(meeting(0.5)).values()
    assert step == 68
    # It stops within 51 mm, at 4 m/s² and 0.04 s after it has decided to.
    assert when == 60
    assert "braking at step 60 would have avoided it" in " ".join(judge(meeting(0.5), SOLD))
    # What appears 60 mm before it, and who walks into it, also after he has stood for a second.
    near = {"speed": 0.5, "starts": 60}, {"speed": 0.0, "walks": 0.8}
    for found in (meeting(**row) for row in (*near, {**near[1], "speed": 0.1, "starts": 200})):
        ((step, when),), excused = touched(found).values(), excuses(found, [])
        assert when is None
        assert excused.ran_into == ["crate_box"]
        assert excused.overlaps == step


def appearing(gap, *, pair=("chassis", "crate_box"), force=300.0, later=3):
    """Return the log of a crate that is put down before step 2, and hit `later` on; gap: [m]."""
    found = log(texts=(TABLE,))
    found.bodies = {"crate_box": "crate", "chassis": "robot"}
    found.names["plant/poses"] = list(pair)
    places = [(0.0, 0.0, 0.0), (9.0, 0.0, 0.0)], [(0.0, 0.0, 0.0, 1.0)] * 2
    apart = dict(zip(("position", "orientation"), places, strict=True))
    found.messages["plant/poses"] = [(step, apart) for step in range(-100, 80)]
    near = {"pairs": [list(pair)], "peak_force": [0.0], "distance": [gap]}
    hit = {"pairs": [list(pair)], "peak_force": [force], "distance": [0.0]}
    far = {"pairs": [list(pair)], "peak_force": [0.0], "distance": [0.149]}
    found.messages["plant/contacts"] = [(0, far), (1, far)]
    found.messages["plant/contacts"] += [(2, near), (2 + later, hit)]
    return found


CRATE = [{"at": "0.016s", "body": "crate", "position": [1.0, 0.0, 0.0]}]


@pytest.mark.parametrize(
    ("found", "texts"),
    [
        (appearing(0.04), ["crate_box appeared 40 mm from the robot"]),
        (appearing(0.05), []),
        (appearing(0.0), ["crate_box appeared 0 mm from the robot"]),
    ],
)
def test_what_appears_nearer_than_a_base_can_brake_is_nobody_s_fault(found, texts):
    excused = excuses(found, CRATE)
    assert excused.texts == texts
    pressed = [line for line in judge(found, SOLD, excused=excused) if "pressed on" in line]
    assert bool(pressed) is not bool(texts)


def test_a_second_after_something_has_appeared_nobody_may_hit_it():
    found = appearing(0.04, later=70)
    lines = judge(found, SOLD, excused=excuses(found, CRATE))
    assert any("crate_box with 300 N at step 72" in line for line in lines)


def test_what_others_move_is_no_excuse_for_hitting_something_else():
    found = appearing(0.01, pair=("chassis", "pillar_post"))
    assert excuses(found, CRATE).texts == []
