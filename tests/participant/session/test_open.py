"""A session that does not open is an error in time."""

import socket
import tempfile
import threading

import pytest
import zenoh

from stepbus_participant import BusError, Endpoint, ZenohBus
from stepbus_participant.bus import zenoh_bus
from stepbus_participant.bus.zenoh_bus import zenoh_settings


class Panic(BaseException):
    """As a panic of Rust comes to Python: no Exception."""


@pytest.fixture
def endpoint(own_temp):
    with tempfile.TemporaryDirectory() as folder:
        yield Endpoint(
            listen=[f"unixsock-stream/{folder}/0.sock"],
            connect=[],
            user="a",
            password="x",
            users={"a": "x"},
        )


def test_a_session_that_never_opens_is_an_error(monkeypatch, endpoint):
    monkeypatch.setattr(zenoh_bus, "_OPEN_S", 0.1)
    over = threading.Event()
    monkeypatch.setattr(zenoh, "open", lambda _config: over.wait())
    with pytest.raises(BusError, match=r"no Zenoh session opened within 0\.1 s"):
        ZenohBus(endpoint, "run")
    over.set()


def test_a_panic_while_a_session_opens_is_an_error(monkeypatch, endpoint):
    def fail(_config):
        raise Panic("OS can't spawn worker thread")

    monkeypatch.setattr(zenoh, "open", fail)
    with pytest.raises(BusError, match="OS can't spawn worker thread"):
        ZenohBus(endpoint, "run")


def test_connections_that_say_nothing_do_not_hold_up_the_end(endpoint):
    bus = ZenohBus(endpoint, "run")
    links = [socket.socket(socket.AF_UNIX) for _ in range(5)]
    for link in links:
        link.connect(endpoint.listen[0].partition("/")[2])
    # A session that closes waits for them, by default for 10 s; a participant may take 3 s to stop.
    assert zenoh_settings(endpoint, None)["transport/unicast/accept_timeout"] == 1000
    closing = threading.Thread(target=bus.close)
    closing.start()
    closing.join(60)
    assert not closing.is_alive()
    for link in links:
        link.close()
