"""Takes a run to other hosts: the gateway here, an agent on each host over SSH."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.endpoints import Mesh
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.folder import LOGS_FOLDER, read_files
from stepbus_orchestrator.run.hosts import Elsewhere
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_schemas import WiringError, suggest

from . import wire
from .addresses import parse_address
from .agent import SCENARIO
from .connection import Connection
from .gateway import GATEWAY, Gateway
from .hosts_file import read_hosts
from .versions import MUST_AGREE, compared, host_versions

_LEASE_S = 10.0


class Across(Elsewhere):
    """Reaches the participants on other hosts, and those that are joined from there.

    hosts: those that the user has described. listen: `ADDRESS[:PORT]` of the one port that is
    opened; empty: the address by which the first host was reached, a free port.
    """

    def __init__(self, scenario: Scenario, hosts: Path | None, listen: str) -> None:
        self._hosts = {} if hosts is None else read_hosts(hosts)
        self._listen = parse_address(listen) if listen else ("", 0)
        self._is_given = listen
        specs = scenario.participants
        self.names = [one.name for one in specs if one.host or (listen and one.is_external)]
        self.behind = {GATEWAY: self.names} if self.names else {}
        self._links: dict[str, Connection] = {}

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a host that no file describes, and for TCP between the others."""
        for one in scenario.participants:
            if one.host and one.host not in self._hosts:
                near = suggest(one.host, self._hosts)
                raise WiringError(f"{one.name}: --hosts has no host {one.host!r}{near}")
        if self._is_given and not self.names:
            raise WiringError(
                "--listen is for participants on other hosts, which the scenario has none of; name "
                "those that you start yourself with --external"
            )
        if self._hosts and not any(one.host for one in scenario.participants):
            raise WiringError(
                "--hosts: no participant has a host; give one to it, such as "
                f"`--set {scenario.participants[-1].name}.host={next(iter(self._hosts))}`"
            )
        if scenario.bus.transport == "tcp":
            raise WiringError(
                "bus.transport: tcp is TCP on loopback; with participants on other hosts, leave it "
                "out: those here use Unix sockets, the others TLS"
            )

    @contextmanager
    def opened(self, run: RunView, launcher: Launcher, mesh: Mesh) -> Iterator[None]:
        """Open the gateway's port, and reach all hosts; at the end, leave nothing there."""
        if not self.names:
            yield
            return
        self._run, self._launcher = run, launcher
        with ExitStack() as stack:
            files = self._files(run.state.scenario)
            self._digests = {k: hashlib.sha256(v).hexdigest() for k, v in files.items()}
            for name in dict.fromkeys(s.host for s in run.state.scenario.participants if s.host):
                order = wire.Open(
                    run.key,
                    run.token,
                    _LEASE_S,
                    self._hosts[name].folder,
                    self._digests,
                )
                connection = Connection(name, self._hosts[name], order, run.interrupt)
                self._links[name] = connection
                stack.enter_context(launcher.guarded(connection.pid))
                stack.callback(self._leave, connection)
            origin = self._greet(files)
            address, port = self._listen
            self._gateway = Gateway(
                mesh.participants[GATEWAY],
                run.key,
                self.names,
                address=address or origin,
                port=port,
                lease_s=_LEASE_S,
                tell=lambda text: run.observer.event("gateway", address or origin, -1, text),
            )
            self.relay = self._gateway.pid
            stack.enter_context(launcher.guarded(self.relay))
            stack.callback(self._close)
            shown = f"{self._gateway.address}:{self._gateway.port}"
            run.observer.event("listening", shown, -1, f"for {', '.join(self.names)} (mutual TLS)")
            yield

    def _close(self) -> None:
        self._gateway.close()
        if self._gateway.refused:
            text = f"refused {self._gateway.refused} connections and messages of strangers"
            self._run.warn("gateway", text)

    def _leave(self, connection: Connection) -> None:
        for name, text in connection.close():
            self._run.warn(name, text)

    @staticmethod
    def _files(scenario: Scenario) -> dict[str, bytes]:
        """Return the scenario and its files, as a recording has them."""
        return {SCENARIO: resolved(scenario).encode(), **read_files(scenario.files)}

    def _greet(self, files: Mapping[str, bytes]) -> str:
        """Compare what the hosts have with what we have; return the address that reached one."""
        origin, table = "", {"here": host_versions()}
        contents = {hashlib.sha256(content).hexdigest(): content for content in files.values()}
        for name, connection in self._links.items():
            greeting = connection.greeting()
            connection.deliver({key: contents[key] for key in greeting.missing})
            table[name] = greeting.versions
            origin = origin or greeting.origin
        if not self._listen[0] and not origin:
            raise StartFailed("no host says by which address it was reached; give --listen ADDRESS")
        if not self._listen[0]:
            parse_address(origin)
        differing = {name: words for name, is_same, words in compared(table) if not is_same}
        if differing:
            lines = map(": ".join, differing.items())
            text = "the hosts have different versions:\n    " + "\n    ".join(lines)
            if set(differing) & set(MUST_AGREE):
                raise StartFailed(f"{text}\n    install the same stepbus on all of them")
            self._run.warn("hosts", f"{text}\n    results may differ in the last bit")
        return origin

    def start(self, spec: ParticipantSpec, options: dict[str, Any]) -> ParticipantState:
        """Start a participant on its host, or write the ticket with which the user does."""
        gateway, run = self._gateway, self._run
        if not spec.host:
            endpoint = gateway.endpoint_of(spec.name)
            files = {name: digest for name, digest in self._digests.items() if name != SCENARIO}
            attached = self._launcher.admit(spec, endpoint, None, files=files, **options)
            attached.cut = lambda: gateway.cut(spec.name)
            attached.is_silent = lambda: gateway.silence(spec.name)
            run.timing.event("external", spec.name)
            return ParticipantState(spec, attached, external=attached)
        connection = self._links[spec.host]
        fields = {key: options[key] for key in ("faults", "checkpoint") if key in options}
        if options.get("profile") is not None:
            run.warn(spec.name, "is not profiled: its profile would be on another host")
        order = wire.Start(
            spec.name,
            tuple(spec.program),
            spec.join_timeout_ns,
            gateway.endpoint_of(
                spec.name, connection.spec.reaches, compress=connection.spec.compress
            ),
            msgspec.to_builtins(fields),
        )
        process = connection.start(order, run.out / LOGS_FOLDER / f"{spec.name}.log")
        process.is_silent = lambda: gateway.silence(spec.name)
        process.cut = lambda: gateway.cut(spec.name)
        run.timing.event("spawn", spec.name, f"pid {process.remote_pid} on {spec.host}")
        return ParticipantState(spec, process)


class _Adapt(RunExtension):
    """Tells participants on other hosts that their files are in their working directory."""

    def __init__(self, names: list[str]) -> None:
        self._names = names

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario that the participants get."""
        if not self._names:
            return scenario
        bus = msgspec.structs.replace(scenario.bus, low_latency=False)
        return replace(scenario.changed(self._names, folder="."), bus=bus)


def across(scenario: Scenario, hosts: Path | None, listen: str) -> tuple[Elsewhere, RunExtension]:
    """Return what takes a run to other hosts, and the extension that it needs."""
    made = Across(scenario, hosts, listen)
    return made, _Adapt(made.names)
