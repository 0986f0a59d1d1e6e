"""The gateway of a run, as the orchestrator has it: credentials, its process, what that tells."""

import base64
import contextlib
import json
import os
import re
import secrets
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection
from typing import Any

import msgspec
import trustme

from stepbus_orchestrator.errors import BusFailed
from stepbus_participant import Endpoint
from stepbus_schemas import WiringError

from .addresses import open_port, parse_address

GATEWAY = ".gateway"
"""Its name on the bus; no participant's name has a leading dot."""

_START_S = 60.0
_END_S = 5.0
# With the names in its own log, access control has fifty lines a step.
_LOG = (
    "error,zenoh_link_tls=warn,zenoh_transport::unicast::link=debug,"
    "zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::access_control=off"
)
_ACCEPT_MS = 10_000
"""How long a link may take to open: several round trips, of a second each on a bad link."""
_NEW_LINK = re.compile(r"unicast::link: Link .* dst: tls/([^,]+),")
_LINK_S = 3.0
_SHOWN = 400
_TLS = "transport/link/tls/"
_COMPRESSION = "transport/unicast/compression/enabled"
"""A link is compressed where both ends have it on."""


class Gateway:
    """Lets participants on other hosts in, at one address, and speaks for them here.

    endpoint: of its process, as of `make_mesh`. names: of the participants behind it. address,
    port: where it listens; 0: any free port. lease_s: a link that is silent for so long is lost.
    tell: gets a sentence for the user.

    Raises BusFailed where it cannot listen there.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        run: str,
        names: Collection[str],
        *,
        address: str,
        port: int,
        lease_s: float,
        tell: Callable[[str], None],
    ) -> None:
        try:
            open_port(address, port).close()
        except WiringError as exc:
            raise BusFailed(str(exc)) from exc
        self.address, self.port = address, port
        self.refused = 0
        self.links: dict[str, str] = {}
        """Participant → address of its host, while it is linked."""
        self.silent_s: dict[str, float] = {}
        self._run, self._lease_s, self._tell = run, lease_s, tell
        self._authority = trustme.CA()
        self._passwords = {name: secrets.token_hex(16) for name in names}
        self._is_up, self._failed = threading.Event(), ""
        # Zenoh lets no second session in under the number of one that is there.
        self._sessions = {name: f"{1 << 127 | secrets.randbits(127):x}" for name in names}
        self._seen = dict[str, int]()
        self._linking = dict[str, float]()
        """Address of a link that is open, but of no session yet → since when."""
        environment = {k: v for k, v in os.environ.items() if k != "ZENOH_RUNTIME"}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stepbus_hosts.relay"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**environment, "RUST_LOG": _LOG, "NO_COLOR": "1"},
            start_new_session=True,
        )
        self.pid = self._process.pid
        self._write(msgspec.json.encode({"endpoint": self._own(endpoint), "run": run}))
        self._reader = threading.Thread(target=self._read, name="gateway", daemon=True)
        self._reader.start()
        self._is_up.wait(_START_S)
        if self._failed or not self.port:
            why = self._failed or f"the gateway was not up within {_START_S:g} s"
            self.close()
            raise BusFailed(why)

    def _own(self, endpoint: Endpoint) -> Endpoint:
        """Return the endpoint of the process, with all that it is for other hosts."""
        lease_ms = round(1000 * self._lease_s)
        return msgspec.structs.replace(
            endpoint,
            listen=[f"tls/{self.address}:{self.port}"],
            users={**endpoint.users, **self._passwords},
            settings={
                **endpoint.settings,
                **self._certificate(GATEWAY),
                "mode": "router",
                _COMPRESSION: True,
                "transport/link/tx/lease": lease_ms,
                "transport/unicast/accept_timeout": _ACCEPT_MS,
                # What one reader does not take holds up the others no longer than that.
                "transport/link/tx/queue/congestion_control/block/wait_before_close": (
                    1000 * lease_ms
                ),
            },
        )

    def _certificate(self, name: str) -> dict[str, Any]:
        """Return the settings of a new certificate; there is no file of it."""
        issued = self._authority.issue_cert("127.0.0.1", common_name=name)
        files = {
            "certificate": issued.cert_chain_pems[0],
            "private_key": issued.private_key_pem,
        }
        ends = {
            f"{end}_{file}": pem for end in ("listen", "connect") for file, pem in files.items()
        }
        pems = {"root_ca_certificate": self._authority.cert_pem, **ends}
        return {
            **{
                f"{_TLS}{key}_base64": base64.b64encode(pem.bytes()).decode()
                for key, pem in pems.items()
            },
            f"{_TLS}enable_mtls": True,
            # It is known by its common name: its address may be that of a router in between.
            f"{_TLS}verify_name_on_connect": False,
        }

    def endpoint_of(self, name: str, reached: str = "", *, compress: bool = False) -> Endpoint:
        """Return the endpoint of a participant behind the gateway: it opens one link, to there.

        reached: `ADDRESS[:PORT]` of the gateway as seen from there; default: where it listens.
        compress: whether what goes over the link is compressed.
        """
        host, port = parse_address(reached) if reached else (self.address, self.port)
        keys = f"stepbus/{self._run}/**"
        every = ["put", "delete", "query", "reply", "liveliness_token", "declare_subscriber"]
        every += ["declare_queryable", "declare_liveliness_subscriber", "liveliness_query"]
        rule = {"messages": every, "permission": "allow"}
        return Endpoint(
            listen=[],
            connect=[f"tls/{host}:{port or self.port}"],
            low_latency=False,
            user=name,
            password=self._passwords[name],
            settings={
                "mode": "client",
                _COMPRESSION: compress,
                "id": self._sessions[name],
                "transport/link/tx/lease": round(1000 * self._lease_s),
                **self._certificate(name),
                # Another participant's certificate does not make it the gateway.
                "access_control": {
                    "enabled": True,
                    "default_permission": "deny",
                    "rules": [
                        {"id": "out", "flows": ["egress"], "key_exprs": ["**"], **rule},
                        {"id": "in", "flows": ["ingress"], "key_exprs": [keys], **rule},
                    ],
                    "subjects": [
                        {"id": "anyone"},
                        {"id": "gateway", "cert_common_names": [GATEWAY]},
                    ],
                    "policies": [
                        {"subjects": ["anyone"], "rules": ["out"]},
                        {"subjects": ["gateway"], "rules": ["in"]},
                    ],
                },
            },
        )

    def silence(self, name: str) -> str:
        """Return that a participant's host did not answer when last seen; empty: it did."""
        if self._failed:
            return self._failed
        silent_s = self.silent_s.get(name, 0.0)
        return f"{self.links[name]} has not answered for {silent_s:.1f} s" if silent_s else ""

    def cut(self, name: str) -> None:
        """End the link of a participant."""
        self._write(f"cut {name}".encode())

    def close(self) -> None:
        """End the gateway's process, and with it all links to other hosts."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()  # no time-out: it was killed
        self._reader.join(_END_S)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _write(self, line: bytes) -> None:
        try:
            assert self._process.stdin is not None  # noqa: S101
            self._process.stdin.write(line + b"\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            self._failed = self._failed or f"the gateway (pid {self.pid}) has ended"

    def _read(self) -> None:
        """Take what the process tells, and Zenoh in it, until it ends."""
        line = ""
        for raw in self._process.stdout or ():
            line = raw.decode(errors="replace").strip()
            if line.startswith("{"):
                with contextlib.suppress(ValueError):
                    self._take(json.loads(line))
            elif "zenoh_link_tls" in line and " WARN " in line and "Skipping" not in line:
                why = line.rpartition("unicast: ")[2].partition(". Hint")[0]
                self._refuse(f"a connection ({why})")
            elif found := _NEW_LINK.search(line):
                self._linking[found[1]] = time.monotonic()
            elif line.endswith("Msg intercepted!"):
                self._refuse("a message on a key that its sender does not own")
            for address, since in list(self._linking.items()):
                if time.monotonic() - since > _LINK_S:
                    del self._linking[address]
                    self._refuse(f"{address.rpartition(':')[0]}: its ticket is in use")
        said = "" if line.startswith("{") else line[:_SHOWN]
        self._failed = (
            self._failed or f"the gateway (pid {self.pid}) has ended{said and f': {said}'}"
        )
        self._is_up.set()

    def _take(self, row: dict[str, Any]) -> None:
        if "linked" in row:
            self._linking.pop(row["address"], None)
            self.links[row["linked"]] = row["address"].rpartition(":")[0]
            self._tell(f"{row['linked']} has linked from {row['address']}")
        self._failed = row.get("failed", self._failed)
        self.port = row.get("port", self.port)
        # What was told last of a link that is closed by now stays.
        self.silent_s |= {k: v / 1000 for k, v in row.get("silent_ms", {}).items()}
        if "port" in row or "failed" in row:
            self._is_up.set()

    def _refuse(self, what: str) -> None:
        """Count what was refused, and tell the first of each kind, then each power of ten."""
        self.refused += 1
        count = self._seen[what] = self._seen.get(what, 0) + 1
        if set(str(count)[1:]) <= {"0"} and str(count)[0] == "1":
            self._tell(f"refused {what}{f', {count} times so far' if count > 1 else ''}")
