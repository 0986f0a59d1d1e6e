"""Where the base stands: elsewhere, where there is no way to its place, or none for the arm."""

import pytest
from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, shelf_a

GOODS = (("cola", 2), ("cola", 3), ("water", 4))


def test_where_there_is_no_way_to_its_place_the_base_stands_beside_it():
    fails = {("drive", 1): "no_path", ("drive", 2): "no_path", ("home", 1): "no_path"}
    result = sell(FakeStore(shelf_a(*GOODS), fails=fails))
    assert "1 of 1 sales are done" in result.end
    drives = [goal.base for goal in result.goals if goal.type in ("go_to", "go_together")]
    column = -0.2
    assert [place[1] for place in drives[:3]] == pytest.approx([column, column + 0.3, column - 0.3])
    # The first place before the outlet again, and then one beside it.
    assert [place[0] for place in drives[3:]] == pytest.approx([0.0, 0.3])
    text = "\n".join(event.text for event in result.events)
    assert "next, a place 0.30 m beside it" in text


@pytest.mark.parametrize(
    ("states", "outlets"),
    [(("depart", "return"), [0.0, 0.3]), (("reach",), [0.0])],
    ids=["no way for the base", "none for the arm from there"],
)
def test_a_base_that_drives_beside_its_arm_finds_another_place_too(states, outlets):
    fails = dict.fromkeys(((state, 1) for state in states), "no_path")
    result = sell(FakeStore(shelf_a(*GOODS), fails=fails), together=True)
    assert "1 of 1 sales are done" in result.end
    drives = [goal.base for goal in result.goals if goal.type == "go_together"]
    assert [place[1] for place in drives[:2]] == pytest.approx([-0.2, 0.1])
    assert [place[0] for place in drives[2:]] == pytest.approx(outlets)


def test_where_there_is_no_place_left_the_sale_fails():
    fails = {("drive", number): "no_path" for number in range(1, 9)}
    result = sell(FakeStore(shelf_a(*GOODS), fails=fails))
    assert "driving to the shelf: no path" in result.error
    assert len([goal for goal in result.goals if goal.type == "go_to"]) == 7
