"""What Zenoh does with tokens, wildcards and replies, as the notes of docs/protocol.md say."""

import contextlib
import time
from importlib.metadata import version
from queue import SimpleQueue

import pytest
import zenoh
from support.paths import DOCS

from stepbus_participant import Endpoint, ZenohBus

WAIT_S = 30.0
ALL = {"target": zenoh.QueryTarget.ALL}
NONE = {"consolidation": zenoh.ConsolidationMode.NONE}


@pytest.fixture
def sessions(own_temp):
    """Yield three sessions, each linked to the first."""
    hub, *others = (f"unixsock-stream/{own_temp}/{n}" for n in range(3))
    with contextlib.ExitStack() as stack:
        ends = [Endpoint(listen=[hub], connect=[])]
        ends += [Endpoint(listen=[other], connect=[hub]) for other in others]
        yield [stack.enter_context(contextlib.closing(ZenohBus(end, "r"))) for end in ends]


def test_two_tokens_on_one_key_are_one(sessions):
    watcher, first, second = sessions
    events, heard = SimpleQueue(), []
    watcher.watch_alive("alive/*", lambda *event: events.put(event))

    def wait_for(name, alive):
        while (f"alive/{name}", alive) not in heard:
            heard.append(events.get(timeout=WAIT_S))

    for bus, names in ((first, ("arm", "first")), (second, ("arm", "second"))):
        for name in names:
            bus.declare_alive(f"alive/{name}")
        wait_for(names[1], alive=True)
    first.close()
    wait_for("first", alive=False)
    second.declare_alive("alive/more")
    wait_for("more", alive=True)
    assert [alive for key, alive in heard if key == "alive/arm"] == [True]
    second.close()
    wait_for("arm", alive=False)


def test_a_put_on_a_wildcard_arrives_under_the_wildcard(sessions):
    reader, writer, _ = sessions
    samples = {key: SimpleQueue() for key in ("out/arm", "out/base")}
    for key, queue in samples.items():
        reader.subscribe(key, queue.put)
    put, end = writer.publisher("out/*", "text/plain"), time.monotonic() + WAIT_S
    while any(queue.empty() for queue in samples.values()):
        put(b"")
        assert time.monotonic() < end
        time.sleep(0.01)
    assert {queue.get(timeout=WAIT_S).key for queue in samples.values()} == {"out/*"}


def test_two_replies_come_to_a_query_to_all_without_consolidation_only(sessions):
    asker, *answerers = sessions
    for n, bus in enumerate(answerers):
        bus.answer("join", lambda request, n=n: request.reply(b"%d" % n, "text/plain"))
    end = time.monotonic() + WAIT_S
    while len(list(asker.query("join", b"", "text/plain", WAIT_S))) < 2:
        assert time.monotonic() < end
        time.sleep(0.01)
    counts = [
        len(list(asker.session.get("stepbus/r/join", timeout=WAIT_S, **how)))
        for how in ({}, ALL, NONE, ALL | NONE)
    ]
    assert counts == [1, 1, 1, 2]


def test_the_notes_are_of_the_version_that_is_tested():
    notes = (DOCS / "protocol.md").read_text().partition("## Notes for implementers")[2]
    assert f"What eclipse-zenoh {version('eclipse-zenoh')} does" in notes
