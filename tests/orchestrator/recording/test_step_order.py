"""The recording is ordered by step, then participant, then port, whatever arrives when (P13.1)."""

import msgspec

from stepbus_orchestrator.recording.sink import Sink
from stepbus_schemas import Outputs

PORTS = {"plant": ["state", "image"], "mission": ["goal"]}


def outputs(step, *ports, bulk=None):
    raw = {port: msgspec.Raw(f"{port}{step}".encode()) for port in ports}
    return Outputs(token="", step=step, t_ns=0, ports=raw, bulk=bulk or {})


def order(*offered):
    """Return a sink to which (name, outputs) were offered."""
    found = Sink(PORTS)
    for name, item in offered:
        found.offer(name, item)
    return found


def text(order, steps):
    """Return what is written in these steps, as text."""
    rows = [row for step in steps for row in order.take(step)]
    return " ".join(
        f"{row.participant}.{port}@{row.step}" for row in rows for port, _ in row.content
    )


def test_steps_come_before_participants_and_participants_before_ports():
    arrived = [
        ("mission", outputs(0, "goal")),
        ("mission", outputs(1, "goal")),
        ("plant", outputs(0, "image", "state")),
        ("plant", outputs(1, "state")),
    ]
    schedule = text(order(*arrived), range(2))
    assert schedule == "plant.state@0 plant.image@0 mission.goal@0 plant.state@1 mission.goal@1"


def test_a_participant_that_published_nothing_has_its_step_all_the_same():
    ((row),) = order(("plant", outputs(4))).take(4)
    assert (row.participant, row.step, row.content) == ("plant", 4, [])


def test_a_step_waits_for_its_bulk_content():
    found = order(("plant", outputs(0, "state", bulk={"image": 3})), ("plant", outputs(1)))
    assert (list(found.complete_below(2)), found.owing_bulk()) == ([], {"plant": 0})
    found.offer_bulk("plant", "image", 0, b"abc")
    assert (list(found.complete_below(2)), found.owing_bulk()) == ([0, 1], {})


def test_bulk_content_may_come_before_the_outputs_that_announce_it():
    found = Sink(PORTS)
    found.offer_bulk("plant", "image", 0, b"abc")
    found.offer("plant", outputs(0, "state", bulk={"image": 3}))
    ((row),) = found.take(0)
    assert row.content == [("state", b"state0"), ("image", b"abc")]


def test_bulk_content_of_another_length_is_the_fault_of_its_participant():
    found = order(("plant", outputs(0, "state", bulk={"image": 3})))
    found.offer_bulk("plant", "image", 0, b"abcd")
    ((row),) = found.take(0)
    assert row.content == [("state", b"state0")]
    assert "announced 3 bytes on bulk port 'image' and sent 4" in str(row.fault)


def test_a_step_is_complete_once():
    found = order(("plant", outputs(0)))
    assert (list(found.complete_below(1)), list(found.complete_below(1))) == ([0], [])


def test_at_the_end_only_those_who_close_are_kept_and_nothing_behind_the_closing_step():
    ahead = [(name, outputs(step, "state", "goal")) for name in PORTS for step in (5, 6, 7)]
    found = order(*ahead)
    found.drop_behind(5, ["plant"])
    assert (found.steps(), text(found, [5])) == ([5], "plant.state@5")
