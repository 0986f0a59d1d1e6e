"""Who has no credentials gets no link, and who has them speaks for itself alone."""

import json

import pytest
import zenoh
from support.runs.stranger import disturbed

import stepbus
from stepbus_orchestrator.processes.endpoints import certificates
from stepbus_participant import load_ticket

pytestmark = pytest.mark.usefixtures("nothing_is_left")
TRANSPORTS = ("unix", "tcp")


def without_credentials(links, **further):
    """Return an open session that is no member of the run."""
    settings = {
        "mode": "peer", "listen/endpoints": [], "connect/endpoints": sorted(links),
        "connect/timeout_ms": 500, "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
        "transport/unicast/qos/enabled": False, "transport/unicast/lowlatency": True, **further,
    }  # fmt: skip
    config = zenoh.Config()
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


def links_of(folder):
    tickets = [
        load_ticket({"STEPBUS_TICKET": str(path)}) for path in folder.glob("stepbus-*/*.ticket")
    ]
    links = {link for ticket in tickets for link in (*ticket.endpoint.listen, *ticket.endpoint.connect)}  # fmt: skip
    # The controller is frozen: a session that waits for it closes 10 s late.
    return links - {link for ticket in tickets if ticket.name == "controller" for link in ticket.endpoint.listen}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_without_credentials_there_is_no_link(tmp_path, own_temp, reference, transport):
    heard, peers = [], []

    def act(stranger, _token):
        with without_credentials(links_of(own_temp)) as session:
            session.declare_subscriber("**", heard.append, allowed_origin=zenoh.Locality.REMOTE)
            run = stranger.key
            for key in ("trigger", "stop", "out/plant", "log/plant", "fault/plant"):
                session.put(f"stepbus/{run}/{key}", b"\x80")
            peers.extend(session.info.peers_zid())

    result = disturbed(tmp_path, own_temp, act, f"bus.transport={transport}")
    assert (heard, peers) == ([], [])
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    assert result.unauthenticated == 1
    assert set(result.drops.values()) == {0}


@pytest.mark.slow
def test_a_certificate_of_another_authority_gets_no_link(tmp_path, own_temp, reference):
    (tmp_path / "keys").mkdir()
    forged = certificates(["controller"], tmp_path / "keys")["controller"]
    peers = []

    def act(stranger, _token):
        with without_credentials(links_of(own_temp), **forged) as session:
            peers.extend(session.info.peers_zid())

    result = disturbed(tmp_path, own_temp, act, "bus.transport=tcp")
    assert peers == []
    assert (result.exit_code, result.sha256) == (0, reference.sha256)


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_nobody_speaks_for_another_to_the_orchestrator(tmp_path, own_temp, reference, transport):
    def act(stranger, _token):
        for key in ("log/plant", "ready/plant", "fault/plant", "log/mission"):
            stranger.bus.publisher(key, "application/octet-stream")(b"\x80")

    result = disturbed(tmp_path, own_temp, act, f"bus.transport={transport}")
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    # The one query that ends the act; what was sent before it, on the same link, is not counted.
    assert result.unauthenticated == 1


FORGER = """
import runpy, threading, time

from stepbus_participant import ZenohBus, load_ticket
from stepbus_schemas import Stop, encode, encoding_of

subscribe = ZenohBus.subscribe

def forge(bus):
    stop = encode(Stop(token=load_ticket().token, reason="forged", at_step=-1))
    put = bus.publisher("stop", encoding_of("Stop/1"), remote=True)
    while True:
        put(stop)
        time.sleep(0.01)

def subscribe_and_forge(bus, key, sink):
    subscribe(bus, key, sink)
    if key == "stop":
        threading.Thread(target=forge, args=[bus], daemon=True).start()

ZenohBus.subscribe = subscribe_and_forge
runpy.run_module("stepbus_participant", run_name="__main__")
"""
FORGED = """
name: forged
extends: two_link
duration: 1s
participants:
  NAME:
    exec: [python, forger.py, 'stepbus_NAME:CLASS']
"""


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize(
    "name",
    ["mission", *(pytest.param(name, marks=pytest.mark.slow) for name in ("plant", "controller"))],
)
def test_no_participant_takes_a_stop_from_another_one(tmp_path, name, transport):
    (tmp_path / "forger.py").write_text(FORGER)
    scenario = tmp_path / "forged.yaml"
    scenario.write_text(FORGED.replace("NAME", name).replace("CLASS", name.capitalize()))
    result = stepbus.run(scenario, out=tmp_path / "run", set={"bus.transport": transport})
    assert (result.exit_code, result.steps) == (0, 200), result.reason
