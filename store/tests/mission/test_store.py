"""Sales: the good run, attempts, items that are missing, and what is refused before a run."""

import math
import re

import pytest
from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, Thing, config, shelf_a

from stepbus_participant import CallError
from stepbus_schemas import Description, WiringError
from stepbus_store.mission.checks import PLANNABLE
from stepbus_store.mission.state import APPROACHES
from stepbus_store.mission.store_mission import StoreMission

ONE_SALE = (
    "order>tuck>drive>open>inspect>find>approach>correct>check_width>down>close>check_grip>lift>check_lift>"
    "retreat>check_height>reverse>home>above>aim>place>let_go>up>verify"
)
GOODS = (("cola", 2), ("cola", 3), ("water", 4), ("juice", 5))


def path(result):
    return ">".join(state for state, _, _ in result.walked)


def goal_from(result, state, number=0):
    places = [at for at, sender in enumerate(result.goal_states) if sender == state]
    return result.goals[places[number]]


def test_a_sale_passes_through_the_states_of_the_main_flow():
    assert path(sell(FakeStore(shelf_a(*GOODS)))) == f"{ONE_SALE}>order>park"


def test_several_orders_stand_in_a_row():
    store = FakeStore(shelf_a(*GOODS))
    result = sell(store, orders=["water", {"type": "cola"}, {"item": "juice_a1_5"}])
    assert result.end == "3 of 3 sales are done"
    xs = [store.things[name].x for name in ("water_a1_4", "cola_a1_2", "juice_a1_5")]
    assert xs == pytest.approx([0.03, 0.15, 0.27])


def test_what_is_ordered_by_a_call_stands_beside_the_others():
    store, answers = FakeStore(shelf_a(*GOODS)), []

    def ask(calls):
        answers.extend(calls["order"].function(kind) for kind in ("water", "juice"))

    result = sell(store, orders=["cola"], ask=ask)
    assert result.end == "3 of 3 sales are done"
    assert answers == [2, 3]
    xs = [store.things[name].x for name in ("cola_a1_2", "water_a1_4", "juice_a1_5")]
    assert xs == pytest.approx([0.15, 0.27, 0.03])


@pytest.mark.parametrize(
    ("orders", "text"),
    [(["cole"], "type 'cole' is unknown; did you mean 'cola'?"), (["cola"] * 3, "outlet is full")],
)
def test_what_cannot_be_sold_is_not_ordered(orders, text):
    def ask(calls):
        for kind in orders[:-1]:
            calls["order"].function(kind)
        with pytest.raises(CallError, match=re.escape(text)):
            calls["order"].function(orders[-1])

    assert "sales are done" in sell(FakeStore(shelf_a(*GOODS, ("cola", 1))), ask=ask).end


def test_ten_orders_stand_in_two_rows_the_one_at_the_back_first():
    goods = [(kind, column) for column, kind in enumerate(["cola", "juice"] * 5, 1)]
    store = FakeStore(shelf_a(*goods))
    outlet = {"position": [0.15, 0.65, 0.35], "pitch": 0.1, "rows": 2}
    result = sell(store, orders=["cola", "juice"] * 5, outlet=outlet)
    assert result.end == "10 of 10 sales are done"
    rows = sorted((round(t.y, 3), round(t.x, 3)) for t in store.things.values())
    xs = [-0.05, 0.05, 0.15, 0.25, 0.35]
    assert rows == [*((0.58, x) for x in xs), *((0.72, x) for x in xs)]
    first = store.things["cola_a1_1"]
    assert (first.x, first.y) == pytest.approx((-0.05, 0.72))


def test_the_summary_is_a_table_of_the_sales():
    result = sell(FakeStore(shelf_a(*GOODS), shift=(0.003, 0.0)), orders=["cola", "juice"])
    header, first, second, last = result.summary.splitlines()
    assert header.split() == [
        "sale", "item", "attempts", "detection", "place", "others", "duration",
    ]  # fmt: skip
    assert first.split()[:5] == ["1", "cola_a1_2", "1", "3.0", "mm"]
    assert second.split()[:5] == ["2", "juice_a1_5", "1", "3.0", "mm"]
    assert last.startswith("2 of 2 sales in ")


def test_the_base_stands_before_the_column_of_the_item():
    result = sell(FakeStore(shelf_a(*GOODS)), stand=0.4)
    assert goal_from(result, "drive").base == pytest.approx((1.55, -0.2, 0.0))


def test_the_base_faces_a_shelf_that_stands_to_the_right():
    things = {"cola_b1_1": Thing("cola", 0.1, -2.015, 0.2575)}
    result = sell(FakeStore(things))
    assert result.end
    assert goal_from(result, "drive").base == pytest.approx((0.1, -1.5, -math.pi / 2))


def test_the_hand_points_down_and_opens_along_the_depth_of_the_shelf():
    x, y, z, w = goal_from(sell(FakeStore(shelf_a(*GOODS))), "down").orientation
    y_axis = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    z_axis = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    assert y_axis == pytest.approx((1.0, 0.0, 0.0))
    assert z_axis == pytest.approx((0.0, 0.0, -1.0))


def test_a_turned_box_is_gripped_at_its_sides():
    store = FakeStore(shelf_a(("juice", 4)))
    store.things["juice_a1_4"].yaw = math.pi / 2 + 0.2
    x, y, _, _ = goal_from(sell(store, orders=["juice"]), "down").orientation
    assert 2 * math.atan2(y, x) - math.pi / 2 == pytest.approx(0.2)


def test_a_bottle_is_gripped_at_its_body_with_its_neck_in_the_hand():
    result = sell(FakeStore(shelf_a(*GOODS)), orders=["water"], grasp_reach=0.06)
    assert goal_from(result, "down").position[2] == pytest.approx(0.2 + 0.15 - 0.06)


def test_only_the_item_may_be_touched_on_the_way_down_and_nothing_on_the_way_there():
    result = sell(FakeStore(shelf_a(*GOODS)))
    assert goal_from(result, "approach").touches == []
    assert goal_from(result, "down").touches == ["cola_a1_2"]
    assert goal_from(result, "place").touches == ["cola_a1_2", "outlet_top"]


def test_a_carried_item_is_lowered_in_steps_before_the_base_moves():
    result = sell(FakeStore(shelf_a(*GOODS)), safe_height=0.15)
    states = path(result)
    assert (
        "retreat>check_height>lower>check_height>lower>check_height>lower>check_height>reverse"
        in states
    )
    heights = [goal_from(result, "lower", number).position[2] for number in range(3)]
    assert heights == pytest.approx([0.3, 0.2, 0.15])


def test_the_hand_follows_what_it_sees_until_that_is_steady():
    # From above the camera is 8 mm off; from near it sees the item where it is.
    result = sell(FakeStore(shelf_a(*GOODS), pushes={("approach", 1): ("cola_a1_2", 0.008)}))
    assert "approach>correct>shift>correct>check_width>down" in path(result)
    assert result.end


def goals_from(store, state):
    return [goal for goal, sent in zip(store.goals, store.states, strict=True) if sent == state]


def heading(goal):
    """Return the direction of the fingers, of a gripper that points down, below a half turn."""
    x, y, z, w = goal.orientation
    return math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)) % math.pi


def test_where_the_line_down_is_blocked_the_gripper_is_turned():
    store = FakeStore(shelf_a(*GOODS), fails={("down", 1): "blocked"})
    result = sell(store)
    assert "down>retry>approach>correct>check_width>down>close" in path(result)
    first, second = map(heading, goals_from(store, "down"))
    assert abs(second - first) == pytest.approx(math.pi / 2)
    assert "next, with the gripper turned by 90°" in result.text
    assert result.end


def test_the_approaches_differ():
    fails = {("down", number): "blocked" for number in range(1, 8)}
    store = FakeStore(shelf_a(*GOODS), fails=fails)
    result = sell(store)
    assert result.end
    goals, above = goals_from(store, "down"), goals_from(store, "approach")
    widths = [
        [g for g in result.goals[: result.goals.index(goal)] if g.type == "grip"][-1].width
        for goal in goals
    ]
    rows = [
        (goal.type, goal.orientation, up.position[2], width)
        for goal, up, width in zip(goals, above, widths, strict=True)
    ]
    assert len(set(rows)) == len(APPROACHES)


@pytest.mark.parametrize("state", sorted(PLANNABLE))
def test_a_planned_path_stands_for_a_line_that_is_blocked(state):
    faults = {"slips": 1} if state == "back_off" else {}
    faults = {"noise": 0.006} if state == "shift" else faults
    store = FakeStore(shelf_a(*GOODS), fails={(state, 1): "blocked"}, **faults)
    result = sell(store, safe_height=0.25)
    assert [goal.type for goal in goals_from(store, state)][:2] == ["move_linear", "move_to_pose"]
    assert "; along a planned path instead" in result.text
    assert result.end


def test_corrections_come_to_an_end():
    store = FakeStore(shelf_a(*GOODS), noise=0.006)
    result = sell(store, corrections=2)
    assert path(result).count("shift") == 2
    assert "6.0 mm away after 2 corrections" in result.text


def test_a_grasp_that_fails_is_told_and_tried_again_with_another_look():
    result = sell(FakeStore(shelf_a(*GOODS), empty_grips=1))
    assert "check_grip>retry>release>back_off>inspect>find" in path(result)
    (told,) = result.errors
    assert "attempt 1 of 2 failed" in told
    assert result.summary.splitlines()[1].split()[2] == "2"
    assert result.end == "1 of 1 sales are done"


def test_a_missing_item_is_told_and_the_next_of_its_kind_is_taken():
    result = sell(FakeStore(shelf_a(*GOODS), hidden=("cola_a1_2",)))
    assert "missing, no cola within 60 mm" in result.text
    assert "cola_a1_3" in result.summary
    assert result.end


def test_what_is_in_the_way_after_the_last_sale_does_not_undo_it():
    result = sell(FakeStore(shelf_a(*GOODS), fails={("park", 1): "no_path"}))
    assert result.end == "1 of 1 sales are done"
    assert "the arm stays" in result.text


def test_an_item_of_another_kind_at_the_place_is_not_taken():
    store = FakeStore(shelf_a(*GOODS), hides={})
    mission_kind = store.things["cola_a1_2"]
    store.hidden = ("cola_a1_2",)
    store.things["water_a1_9"] = Thing("water", mission_kind.x + 0.01, mission_kind.y, 0.25)
    assert "cola_a1_3" in sell(store).summary


def test_every_problem_of_the_parameters_is_listed_at_once():
    wrong = {
        "orders": ["cola", {"typ": "cola"}, 3, {"type": "x", "item": "x_a1_1"}],
        "shelves": {"a": {"fron": [1, 2]}, "b": 3},
        "outlet": {"position": [1, 2], "pitch": 0.2, "link": ""},
        "tuck": [],
        "tip": 3,
        "base_frame": ["chassis"],
        "attempts": 0,
        "views": 1.5,
        "waits": {"stil": 1, "camera": -1},
        "speed": 3,
    }
    with pytest.raises(WiringError) as caught:
        StoreMission(config(**wrong))
    text = str(caught.value)
    for part in (
        "params.orders[1].typ: unknown key 'typ'; did you mean 'type'?",
        "params.orders[2]: must be text or a map, not 3",
        "params.orders[3]: needs either an item type, `type: cola`, or an item, `item: cola_a1_3`",
        "params.shelves.a.fron: unknown key 'fron'; did you mean 'front'?",
        "params.shelves.a: the key 'front' is missing",
        "params.shelves.b: must be a map, not 3",
        "params.outlet.position: must be a list of 3 values, not a list of 2",
        "params.outlet.link: must be text that is not empty",
        "params.tip: must be text that is not empty, not 3",
        "params.base_frame: must be text that is not empty, not a list",
        "params.tuck: must be a map, not a list",
        "params.views: must be an integer of at least 1, not 1.5",
        "params.attempts: must be an integer of at least 1, not 0",
        "params.waits.stil: unknown key 'stil'; did you mean 'still'?",
        "params.waits.camera: must be a number above 0, not -1",
        "params.speed: unknown key 'speed'",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"orders": [{"item": "x_a1_1"}] * 2}, "params.orders: item 'x_a1_1' is ordered twice"),
        (
            {"orders": ["cola"] * 5, "outlet": {"position": [1, 2, 3], "pitch": 0.2}},
            "params.outlet: 5 orders, 0.2 m apart, do not fit into 0.5 m",
        ),
        ({"tuck": {}}, "params.tuck: is empty"),
    ],
)
def test_orders_shelves_and_outlet_have_to_fit_together(params, text):
    with pytest.raises(WiringError) as caught:
        StoreMission(config(**params))
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("params", "text"),
    [
        (
            {"orders": [{"item": "cola_a1_8"}]},
            "item 'cola_a1_8' is unknown; did you mean 'cola_a1_",
        ),
        ({"orders": ["cole"]}, "type 'cole' is unknown; did you mean 'cola'?"),
        (
            {"outlet": {"position": [0, 0, 0], "link": "outlt_top"}},
            "link 'outlt_top' is unknown; did you mean 'outlet_top'?",
        ),
    ],
)
def test_names_that_the_plant_lacks_are_refused(params, text):
    mission = StoreMission(config(**params))
    with pytest.raises(WiringError) as caught:
        mission.start({"poses": FakeStore(shelf_a(*GOODS)).description()})
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("world", "text"),
    [
        (
            "stock: {types: {cola: {}, water: {}}}",
            "params.orders[1]: type 'cole' is unknown; did you mean 'cola'?",
        ),
        ("bodies: {}", "params.catalog: world.yaml has no stock.types"),
        ("stock: [", "params.catalog: "),
    ],
)
def test_orders_of_a_type_that_the_catalog_lacks_are_refused_before_the_start(
    world, text, tmp_path
):
    (tmp_path / "world.yaml").write_text(world)
    catalog = str(tmp_path / "world.yaml")
    with pytest.raises(WiringError) as caught:
        StoreMission(config(orders=["water", "cole"], catalog=catalog))
    assert text in str(caught.value)


def test_a_type_of_the_catalog_may_be_sold_out(tmp_path):
    (tmp_path / "world.yaml").write_text("stock: {types: {cola: {}, soup: {}}}")
    catalog = str(tmp_path / "world.yaml")
    result = sell(FakeStore(shelf_a(*GOODS)), orders=["soup", "cola"], catalog=catalog)
    assert result.end.startswith("1 of 2 sales are done; no soup")


def test_an_item_without_measures_is_refused():
    details = {"type": ["", "", "cola"], "shape": ["", "", "mesh @ 0 0 0 0 0 0 1"]}
    mission = StoreMission(config())
    with pytest.raises(WiringError, match="item 'cola_a1_1' has the shape 'mesh"):
        mission.start(
            {"poses": Description(names=["chassis", "outlet_top", "cola_a1_1"], details=details)}
        )


def test_a_motion_that_took_longer_than_it_should_is_reported():
    store = FakeStore(
        shelf_a(*GOODS), slower={("down", 1): "took 4.80 s instead of 1.50 s: a_tier"}
    )
    assert "moving down took 4.80 s instead of 1.50 s" in sell(store).text
