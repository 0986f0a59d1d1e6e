"""The bus in memory does what the bus of a run does."""

import threading
import time
from queue import SimpleQueue

import pytest

from stepbus.errors import BusError
from stepbus.testing import LoopbackBus
from stepbus.wiring import Bus, Endpoint
from stepbus_participant import ZenohBus


@pytest.fixture(params=["loopback", "zenoh"])
def buses(request, tmp_path):
    """Return two linked buses."""
    if request.param == "loopback":
        one = LoopbackBus()
        made = (one, LoopbackBus(one))
    else:
        first, second = (f"unixsock-stream/{tmp_path}/{n}.sock" for n in range(2))
        made = (
            ZenohBus(Endpoint(listen=[first], connect=[]), "test"),
            ZenohBus(Endpoint(listen=[second], connect=[first]), "test"),
        )
    yield made
    for bus in made:
        bus.close()


def until(found, deadline_s=10.0):
    """Wait until something is true."""
    end = time.monotonic() + deadline_s
    while not found():
        assert time.monotonic() < end
        time.sleep(0.01)


def link(one: Bus, other: Bus) -> None:
    """Wait until what one publishes reaches the other."""
    heard = threading.Event()
    other.subscribe("link", lambda _sample: heard.set())
    put = one.publisher("link", "text/plain")

    def is_linked():
        put(b"")
        return heard.is_set()

    until(is_linked)


def test_a_sample_arrives_with_all_its_parts(buses):
    one, other = buses
    inbox = SimpleQueue()
    other.subscribe("log/*", inbox.put)
    link(one, other)
    one.publisher("log/plant/more", "text/plain")(b"another key")
    one.publisher("log/plant", "text/plain")(b"content", attachment=b"stamp")
    sample = inbox.get(timeout=10)
    assert (sample.key, sample.payload) == ("log/plant", b"content")
    assert (sample.encoding, sample.attachment) == ("text/plain", b"stamp")


def test_an_answer_may_come_later_from_another_thread(buses):
    one, other = buses
    asked = SimpleQueue()
    other.answer("join", asked.put)
    link(one, other)
    thread = threading.Thread(target=lambda: asked.get().reply(b"late", "text/plain"))
    thread.start()
    assert next(iter(one.query("join", b"", "text/plain", 10.0))) == b"late"
    thread.join()


def test_who_comes_and_goes_is_seen(buses):
    one, other = buses
    seen = []
    one.declare_alive("alive/plant")
    link(one, other)
    other.watch_alive("alive/*", lambda key, alive: seen.append((key, alive)))
    until(lambda: seen == [("alive/plant", True)])
    one.close()
    until(lambda: seen == [("alive/plant", True), ("alive/plant", False)])


def test_a_closed_loopback_bus_refuses_to_publish_and_gets_nothing():
    one = LoopbackBus()
    other, got = LoopbackBus(one), []
    other.subscribe("key", got.append)
    put = other.publisher("key", "text/plain")
    other.close()
    other.close()
    one.publisher("key", "text/plain")(b"data")
    assert got == []
    with pytest.raises(BusError, match="key: the bus is closed"):
        put(b"data")


def test_a_query_without_an_answer_ends_at_its_time_out():
    one = LoopbackBus()
    one.answer("join", lambda _request: None)
    assert list(one.query("join", b"", "text/plain", 0.01)) == []
    assert list(one.query("nobody", b"", "text/plain", 10.0)) == []
