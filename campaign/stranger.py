"""What strangers do, in a process of their own: `stranger.py [--nobody] DEED ADDRESS…`.

A deed runs until the process is killed. Addresses are Zenoh's; `caller` takes a folder of a run.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import ssl
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import zenoh

# What a Zenoh session sends first: InitSyn, recorded from version 1.
INIT_SYN = bytes.fromhex("2000c109f19bd490256d0464411587a3824e9687cd0ac8ffc205efe897b90a852701")
NOBODY = 65534
KEYS = ("trigger", "stop", "start", "ready/plant", "fault/plant", "log/plant", "out/plant", "join")


def configured(addresses: list[str], **further: object) -> Any:
    """Return the configuration of a session that connects to these addresses."""
    config = zenoh.Config()
    settings = {
        "mode": "peer", "connect/endpoints": addresses, "listen/endpoints": [],
        "connect/timeout_ms": 3000, "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
        "transport/unicast/qos/enabled": False, "transport/unicast/lowlatency": True,
        "transport/shared_memory/enabled": False, **further,
    }  # fmt: skip
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def subscribe(addresses: list[str], **further: object) -> None:
    """Subscribe to everything, then stop reading."""
    stop_reading(zenoh.open(configured(addresses, **further)))


def subscribe_with_qos(addresses: list[str]) -> None:
    """Do the same by the other transport."""
    unicast = "transport/unicast"
    subscribe(addresses, **{f"{unicast}/qos/enabled": True, f"{unicast}/lowlatency": False})


def subscribe_stolen(tickets: list[str]) -> None:
    """Do the same with the credentials of a participant."""
    endpoint = json.loads(Path(random.choice(tickets)).read_bytes())["endpoint"]
    tls = {key: value for key, value in endpoint["settings"].items() if "tls" in key}
    subscribe(endpoint["connect"] + endpoint["listen"], **credentials(endpoint), **tls)


def credentials(endpoint: dict[str, Any]) -> dict[str, object]:
    """Return the settings of a session with the name and password of an endpoint."""
    auth = "transport/auth/usrpwd"
    return {f"{auth}/user": endpoint["user"], f"{auth}/password": endpoint["password"]}


def stop_reading(session: Any) -> None:
    """Subscribe to everything, and stop this process."""
    _subscriber = session.declare_subscriber("**", lambda _sample: None)
    time.sleep(0.3)
    ready()
    os.kill(os.getpid(), signal.SIGSTOP)


def intrude(addresses: list[str]) -> None:
    """Publish on every key of the run, without its secrets."""
    by_tls = [address.replace("tcp/", "tls/") for address in addresses if "tcp/" in address]
    session = zenoh.open(configured(addresses + by_tls))
    ready()
    while True:
        for key in KEYS:
            session.put(key, b"\x81\xa5token\xa1x")
            session.put("stepbus/" + key, b"garbage")
            session.put(f"stepbus/{random.randbytes(8).hex()}/{key}", random.randbytes(50))
        time.sleep(0.005)


def flood(addresses: list[str]) -> None:
    """Connect some hundred times, and say nothing."""
    hold([link for address in addresses for link in connected(address, 120)])


def babble(addresses: list[str]) -> None:
    """Connect, begin a session or send nonsense, and break off, again and again."""
    held: deque[socket.socket] = deque(maxlen=20)
    ready()
    while True:
        for address in addresses:
            hello = client_hello() if address.startswith("tcp/") else INIT_SYN
            size = random.choice((0, 1, 100, 70_000))
            said = random.choice(
                (hello[: random.randrange(1, len(hello) + 1)], random.randbytes(size))
            )
            for link in connected(address, 1):
                with contextlib.suppress(OSError):
                    link.sendall(said)
                # Some are closed at once, others stay open a while.
                if random.random() < 0.5:
                    link.close()
                held.append(link)
        time.sleep(0.01)


def client_hello() -> bytes:
    """Return how a TLS session begins."""
    sent = ssl.MemoryBIO()
    link = ssl.create_default_context().wrap_bio(ssl.MemoryBIO(), sent, server_hostname="x")
    with contextlib.suppress(ssl.SSLError):
        link.do_handshake()
    return sent.read()


def call(folders: list[str]) -> None:
    """Call a run as its user may, with nonsense, then stop reading."""
    live = json.loads((Path(folders[0]) / ".live.json").read_bytes())
    endpoint = live["endpoint"]
    settings = {**credentials(endpoint), **endpoint["settings"]}
    session = zenoh.open(configured(endpoint["connect"], **settings))
    for _ in range(50):
        nonsense = random.randbytes(random.choice((0, 3, 900)))
        session.get(f"stepbus/{live['run']}/call", payload=nonsense, timeout=0.2)
    stop_reading(session)


def connected(address: str, count: int) -> list[socket.socket]:
    """Return so many plain connections; fewer where they are refused."""
    scheme, _, place = address.partition("/")
    links = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            is_tcp = scheme == "tcp"
            link = socket.socket(socket.AF_INET if is_tcp else socket.AF_UNIX)
            link.settimeout(0.5)
            host, _, port = place.rpartition(":")
            link.connect((host, int(port)) if is_tcp else place)
            links.append(link)
    return links


def hold(links: list[socket.socket]) -> None:
    """Keep connections open until the end."""
    ready()
    while links:
        time.sleep(60)


def ready() -> None:
    """Tell our starter that the deed is under way."""
    sys.stdout.write("ready\n")
    sys.stdout.flush()


DEEDS = {
    deed.__name__: deed
    for deed in (
        subscribe, subscribe_with_qos, subscribe_stolen, intrude, flood, babble, call,
    )
}  # fmt: skip


def main() -> None:
    """Do one deed, as the user `nobody` where that is asked for."""
    words = sys.argv[1:]
    if words[0] == "--nobody":
        words.pop(0)
        with contextlib.suppress(PermissionError):
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
    DEEDS[words[0]](words[1:])


if __name__ == "__main__":
    main()
