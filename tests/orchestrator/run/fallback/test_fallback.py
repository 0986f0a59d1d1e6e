"""What is published in the stead of a participant that has failed, without processes."""

import msgspec
import pytest

from stepbus_orchestrator.run.extensions.safe_stop import Substitute
from stepbus_orchestrator.run.player import Player
from stepbus_orchestrator.scenario.model import HoldSpec, ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import (
    SHIPPED,
    BaseCommand,
    Decoder,
    Goal,
    GripperCommand,
    Outputs,
    Plan,
    PlanRequest,
    encode,
)

STEP_NS = 10_000_000
TOKEN = "token"


def published_for(message):
    """Return what is published for a participant that has failed after one message."""
    kind = f"{type(message).__name__}/1"
    spec = ParticipantSpec(name="one", exec=("python",), outputs={"port": OutputSpec(type=kind)})
    sent = []
    substitute = Substitute(
        spec, HoldSpec(keep_ns=0, hold_ns=STEP_NS), token=TOKEN, step_ns=STEP_NS,
        player=Player([spec], STEP_NS, TOKEN, lambda _key, _type: sent.append),
        log=lambda data: None,
    )  # fmt: skip
    ports = {"port": msgspec.Raw(encode(message))}
    substitute.take(encode(Outputs(token=TOKEN, step=0, t_ns=0, ports=ports)))
    substitute.take_over(0, {})
    sent.clear()
    substitute.publish_below(10)
    (data,) = sent
    ports = Decoder(Outputs)(data).ports
    return Decoder(SHIPPED[kind])(ports["port"]) if "port" in ports else None


@pytest.mark.parametrize(
    ("last", "safe"),
    [
        (BaseCommand(vx=1.0, wz=0.5), BaseCommand()),
        (Goal(id=4, type="drive", by=1.0), Goal(id=5, type="stop")),
        (GripperCommand(width=0.0, force=15.0), GripperCommand(width=0.0, force=15.0)),
        (PlanRequest(id=3, start=[0.0], goal=[0.0]), None),
        (
            Plan(id=3, times=[0.0]),
            Plan(id=0, cause="planner_failed", text="the planner has failed"),
        ),
    ],
)
def test_a_held_participant_brings_to_rest_what_it_commands(last, safe):
    assert published_for(last) == safe
