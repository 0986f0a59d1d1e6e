"""The bus over Zenoh: explicit peer links, no discovery, no router."""

import contextlib
import ctypes
import json
import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from . import BusError, Clock, Queue, Request, Sample, every_on_a_thread
from .links import tcp_links, tune
from .ticket import Endpoint, private_folder, unreachable

ONE_THREAD = {
    "ZENOH_RUNTIME": "(rx: (handover: app), acc: (handover: app), tx: (handover: app), "
    "net: (handover: app), app: (worker_threads: 1))"
}
"""One thread for all that Zenoh does: on few cores, each further one is only another to wake up.

Three processes in a chain: 10 → 7 context switches and 320 → 285 µs of CPU time a step, 5,800 →
8,100 steps/s. It changes no result.
"""

_OPEN_S = 10.0
_CLOSE_S, _LOST_S, _LOOK_S = 12.0, 0.5, 0.05
_LIMITS = "check the limits on threads (ulimit -u) and open files (ulimit -n)"
_LEASE_MS = 3_600_000
_SOURCE = re.compile(r" at /\S+\.rs:\d+\.?")
"""Where in Zenoh's source an error was made, on the machine that built it."""
_ACCEPT_MS = 1000
"""How long a link may take to open; a session that closes waits for those that never do."""

_kept = threading.local()


def _keep_thread_state() -> None:
    """Keep the Python thread state of Zenoh's thread from one callback to the next.

    Otherwise each callback creates and destroys one: with the memory for its frames, that is a
    mmap, a page fault and a munmap for every message.
    """
    if not hasattr(_kept, "state"):
        _kept.state = ctypes.pythonapi.PyGILState_Ensure()


def zenoh_settings(endpoint: Endpoint, users_file: str | None) -> dict[str, Any]:
    """Return the Zenoh configuration of an endpoint, by its path in Zenoh's own tree (P2)."""
    settings: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": endpoint.listen,
        "connect/endpoints": endpoint.connect,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        # Retry a peer that is not up yet after 20, 40 … 200 ms.
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        # Gossip with the low-latency transport lost links for good in 6 to 9 of 30 starts.
        "scouting/gossip/enabled": False,
        # With shared memory on, Zenoh moves messages of 3 kB or more into it, and drops them
        # silently when the receiver is not scheduled for 100 ms (eclipse-zenoh/zenoh#2628).
        "transport/shared_memory/enabled": False,
        # After its default of 10 s, Zenoh drops the link to a process that is stopped, in a
        # debugger for example. Here the deadlines of the scenario decide; a dead process closes
        # its sockets.
        "transport/link/tx/lease": _LEASE_MS,
        "transport/unicast/accept_timeout": _ACCEPT_MS,
    }
    if endpoint.low_latency:
        settings["transport/unicast/qos/enabled"] = False
        settings["transport/unicast/lowlatency"] = True
    if endpoint.user is not None:
        settings["transport/auth/usrpwd/user"] = endpoint.user
        settings["transport/auth/usrpwd/password"] = endpoint.password
    if users_file is not None:
        settings["transport/auth/usrpwd/dictionary_file"] = users_file
    return {**settings, **endpoint.settings}


def _cause(endpoint: Endpoint, otherwise: str) -> str:
    """Return that the private folder of the run is gone; `otherwise` where it is there."""
    folder = private_folder(endpoint)
    if folder is None or folder.is_dir():
        return otherwise
    return (
        f"the run's private folder {folder} does not exist; did another process remove it? In a "
        "container, mount it"
    )


def _opened(zenoh: Any, config: Any, endpoint: Endpoint) -> Any:
    """Open a session; raises BusError where it does not open, ZError where it may not.

    Zenoh waits for ever for a thread of its own that could not start (`ulimit -u`), or panics; a
    client waits for its link.
    """
    opened: list[Any] = []

    def work() -> None:
        try:
            opened.append(zenoh.open(config))
        except BaseException as exc:  # noqa: BLE001  (a panic of Rust is no Exception)
            opened.append(exc)

    thread = threading.Thread(target=work, name="zenoh open", daemon=True)
    try:
        thread.start()
    except RuntimeError as exc:
        raise BusError(f"cannot open a Zenoh session: {exc}; {_LIMITS}") from exc
    thread.join(_OPEN_S)
    if not opened and endpoint.settings.get("mode") == "client":
        address = ", ".join(one.partition("/")[2] for one in endpoint.connect)
        what = "is the run over, does another process use its ticket"
        raise BusError(unreachable(address, f"no link within {_OPEN_S:g} s", what))
    if not opened:
        raise BusError(f"no Zenoh session opened within {_OPEN_S} s; {_LIMITS}")
    (session,) = opened
    if isinstance(session, zenoh.ZError):
        raise session
    if isinstance(session, BaseException):
        raise BusError(f"cannot open a Zenoh session: {session}; {_LIMITS}") from session
    return session


def _reply(query: Any, data: bytes, encoding: str) -> None:
    with query:
        query.reply(query.key_expr, data, encoding=encoding)


class ZenohBus:
    """A `Bus` over one Zenoh session, `session`; `run` names the key space.

    Raises BusError when the endpoint cannot be opened.
    """

    clock: Clock = time
    exchange = None

    def __init__(self, endpoint: Endpoint, run: str) -> None:
        import zenoh  # noqa: PLC0415  only opening a bus needs it

        self._zenoh: Any = zenoh
        self._prefix = f"stepbus/{run}/"
        self._held: list[Any] = []
        # One who lets nobody in needs none.
        users_file = self._write_users(endpoint) if endpoint.users else None
        try:
            config = zenoh.Config()
            for path, value in zenoh_settings(endpoint, users_file).items():
                config.insert_json5(path, json.dumps(value))
            self.session: Any = _opened(zenoh, config, endpoint)
        except zenoh.ZError as exc:
            where = ", ".join(endpoint.listen)
            why = _SOURCE.sub("", str(exc)).strip()
            cause = _cause(endpoint, "does another run use this port or socket?")
            raise BusError(f"cannot listen on {where}: {why}; {cause}") from exc
        finally:
            if users_file is not None:
                with contextlib.suppress(OSError):
                    Path(users_file).unlink()
        self._is_client = endpoint.settings.get("mode") == "client"
        if self._is_client:
            for address, link in tcp_links():
                if f"tls/{address}" in endpoint.connect:
                    tune(link)

    @staticmethod
    def _write_users(endpoint: Endpoint) -> str:
        """Write the accepted credentials to a private file, until Zenoh has read it."""
        try:
            handle, name = tempfile.mkstemp(prefix="users-", dir=private_folder(endpoint))
            with os.fdopen(handle, "w") as file:
                file.writelines(f"{user}:{secret}\n" for user, secret in endpoint.users.items())
        except OSError as exc:
            cause = _cause(endpoint, "set TMPDIR to a folder with free space")
            raise BusError(f"cannot write the credentials: {exc.strerror}; {cause}") from exc
        return name

    every = staticmethod(every_on_a_thread)

    def queue(self) -> Queue:
        """Return a queue that Zenoh's thread fills."""
        return SimpleQueue()

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return the put function of a publisher that blocks rather than drops."""
        locality = self._zenoh.Locality
        publisher = self.session.declare_publisher(
            self._prefix + key,
            encoding=encoding,
            congestion_control=self._zenoh.CongestionControl.BLOCK,
            express=True,
            allowed_destination=locality.REMOTE if remote else locality.ANY,
        )
        self._held.append(publisher)
        put: Callable[..., None] = publisher.put
        return put

    def subscribe(self, key: str, sink: Callable[[Sample], None]) -> None:
        """Call `sink` with each sample, on Zenoh's own receiving thread.

        A link has one buffer of 64 KiB to receive into. Zenoh allocates, clears and frees another
        for every message that arrives while one of its samples is held, so all is copied.
        """

        def on_sample(sample: Any) -> None:
            _keep_thread_state()
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            content = sample.payload.to_bytes()
            sink(Sample(self._key(sample), content, attachment, str(sample.encoding)))

        self._subscribe(key, on_sample)

    def subscribe_content(self, key: str, sink: Callable[[bytes], None]) -> None:
        """Call `sink` with the content of each sample, on Zenoh's own receiving thread."""

        def on_sample(sample: Any) -> None:
            _keep_thread_state()
            sink(sample.payload.to_bytes())

        self._subscribe(key, on_sample)

    def _subscribe(self, key: str, on_sample: Callable[[Any], None]) -> None:
        self._held.append(
            self.session.declare_subscriber(self._prefix + key, self._direct(on_sample))
        )

    def _direct(self, callback: Callable[[Any], None]) -> Any:
        """Return a handler; the default, an indirect one, moves every message to another thread."""
        return self._zenoh.handlers.Callback(callback, indirect=False)

    def _key(self, sample: Any) -> str:
        return str(sample.key_expr).removeprefix(self._prefix)

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterator[bytes]:
        """Yield the replies to a query as they arrive, until the time-out."""
        replies: Any = self.session.get(
            self._prefix + key,
            payload=data,
            encoding=encoding,
            timeout=timeout_s,
            target=self._zenoh.QueryTarget.ALL,
            consolidation=self._zenoh.ConsolidationMode.NONE,
        )
        for reply in replies:
            if reply.ok is not None:
                yield bytes(reply.ok.payload.to_bytes())

    def answer(self, key: str, sink: Callable[[Request], None]) -> None:
        """Call `sink` with each query on a key."""

        def on_query(query: Any) -> None:
            payload = b"" if query.payload is None else bytes(query.payload.to_bytes())
            sink(Request(payload, partial(_reply, query)))

        handler = self._direct(on_query)
        self._held.append(
            self.session.declare_queryable(self._prefix + key, handler, complete=True)
        )

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token, which lasts until the session closes or the process dies."""
        self._held.append(self.session.liveliness().declare_token(self._prefix + key))

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever a liveliness token changes."""

        def on_sample(sample: Any) -> None:
            sink(self._key(sample), sample.kind == self._zenoh.SampleKind.PUT)

        token = self.session.liveliness().declare_subscriber(
            self._prefix + key, self._direct(on_sample), history=True
        )
        self._held.append(token)

    def close(self) -> None:
        """Close the session; a process with an open one and a callback hangs at its exit."""
        if self._is_client:
            thread = threading.Thread(target=self._close, name="zenoh close", daemon=True)
            thread.start()
            give_up = time.monotonic() + _CLOSE_S
            while thread.is_alive() and (now := time.monotonic()) < give_up:
                # To a host that is lost, Zenoh connects again, and waits 10 s for that to be over.
                # That it is lost may be heard of before it shows here.
                if not self.session.info.routers_zid():
                    give_up = min(give_up, now + _LOST_S)
                thread.join(_LOOK_S)
        else:
            self._close()
        self._held.clear()

    def _close(self) -> None:
        if not self.session.is_closed():
            # Zenoh gives up after 10 s, where a put to a process that reads nothing is not over.
            with contextlib.suppress(self._zenoh.ZError):
                self.session.close()
