"""What a replay publishes is compared by step, in whatever order its parts arrive."""

import msgspec
import pytest
from support.messages.recordings import write

from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import Recording, Sink
from stepbus_orchestrator.replay.replayed import Replayed
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import BytesMessage, Outputs, Scalars, encode

STEP_NS = 10_000_000
STEPS = 6
PICTURES = {0: b"zero", 2: b"two", 4: b"four"}
"""One every second step, as a camera that is slower than its participant."""
CONTENT = {step: encode(BytesMessage(data=data)) for step, data in PICTURES.items()}


@pytest.fixture
def sink(tmp_path):
    pictures = [BytesMessage(data=PICTURES[s]) if s in PICTURES else None for s in range(STEPS)]
    numbers = [Scalars(values=[float(step)]) for step in range(STEPS)]
    path = write(
        tmp_path / "run.mcap", STEP_NS,
        picture=("Bytes/1", [], pictures), number=("Scalars/1", ["n"], numbers),
    )  # fmt: skip
    spec = ParticipantSpec(
        name="plant", exec=("program",), inputs={},
        outputs={
            "picture": OutputSpec(type="Bytes/1", bulk=True), "number": OutputSpec(type="Scalars/1"),
        },
    )  # fmt: skip
    scenario = Scenario(
        name="test", step_ns=STEP_NS, steps=STEPS, seed=0, window=64, participants=(spec,),
        folder=tmp_path, file=tmp_path / "scenario.yaml",
    )  # fmt: skip
    sink = Sink({"plant": spec.outputs})
    Replayed(Recording(path), scenario, "plant", Tolerance()).compare(sink, scenario)
    return sink


def offer(sink, *steps):
    for step in steps:
        number = msgspec.Raw(encode(Scalars(values=[float(step)])))
        bulk = {"picture": len(CONTENT[step])} if step in CONTENT else {}
        sink.offer(
            "plant",
            Outputs(token="t", step=step, t_ns=step * STEP_NS, ports={"number": number}, bulk=bulk),
        )
        sink.write_below(step + 1)


def content(sink, *steps):
    for step in steps:
        sink.offer_bulk("plant", "picture", step, CONTENT[step])


def counts(check):
    return {
        result.topic: (result.equal, result.different, result.missing, result.added)
        for result in check.results()
    }


@pytest.mark.parametrize(
    "arrival",
    [
        [(offer, range(STEPS)), (content, [0, 2, 4])],
        [(content, [0, 2, 4]), (offer, range(STEPS))],
        [(offer, [0, 1]), (content, [2, 0]), (offer, [2, 3, 4, 5]), (content, [4])],
        [(offer, range(STEPS)), (content, [4, 2, 0])],
    ],
    ids=["late", "early", "mixed", "backwards"],
)
def test_the_order_in_which_bulk_content_arrives_is_no_difference(sink, arrival):
    for act, steps in arrival:
        act(sink, *steps)
    sink.write_below(STEPS)
    sink.reviser.miss_below(STEPS)
    assert (sink.reviser.divergence, sink.owing_bulk()) == (None, {})
    assert counts(sink.reviser) == {"plant/picture": (3, 0, 0, 0), "plant/number": (6, 0, 0, 0)}


def test_content_that_never_comes_is_missing_at_its_step(sink):
    offer(sink, *range(STEPS))
    content(sink, 0, 4)
    assert sink.owing_bulk() == {"plant": 2}
    sink.abort()
    check = sink.reviser
    check.miss_below(STEPS)
    assert (check.divergence.step, check.divergence.type) == (2, "missing")
    assert counts(check) == {"plant/picture": (2, 0, 1, 0), "plant/number": (6, 0, 0, 0)}


def test_content_of_another_length_than_announced_is_a_fault(sink):
    offer(sink, 0)
    sink.offer_bulk("plant", "picture", 0, b"")
    with pytest.raises(ParticipantFault, match=r"announced .* bytes on bulk port 'picture'"):
        sink.write_below(1)
