"""Runs whose participants are on other hosts, each joined there by its ticket."""

import contextlib
import json
import shutil
import signal
import sys
import time

import psutil
from support.paths import CHECKOUT
from support.surroundings import comes_true, has_ended

STEPBUS = (sys.executable, "-m", "stepbus_orchestrator.cli")
NAMES = ("plant", "controller", "mission")
LEASE_S = 10.0
PORT = 7447
SHORT = ("duration=1s",)
ENDLESS = ("duration=1h",)
PATIENT = tuple(f"{name}.step_timeout=60s" for name in NAMES)
_SCENARIO = CHECKOUT / "scenarios/stepbus_scenarios/two_link"
_ENOUGH_BYTES = 50_000


def words_of(settings):
    """Return the arguments for settings of a scenario."""
    return [word for setting in settings for word in ("--set", setting)]


class Distant:
    """A run of two_link with the orchestrator on the first host of a network, the others on one each.

    processes: those that have joined, by participant. started_at: when the last has.
    """

    def __init__(self, folder, wan, *settings, hosts=NAMES, more=()):
        self.folder, self.wan, self.hosts = (
            folder,
            wan,
            dict(zip(hosts, range(1, 10), strict=False)),
        )
        self.out, self.processes, self.joined = folder / "out", {}, {}
        outside = [w for name in hosts for w in ("--external", f"{name}={self.ticket(name)}")]
        words = (
            "run",
            "two_link",
            *outside,
            "--listen",
            f"{wan.addresses[0]}:{PORT}",
            "--out",
            self.out,
        )
        words = (*words, "--no-report", *words_of(settings), *more)
        self.terminal = folder / "terminal.txt"
        self.orchestrator = self.start(0, *words, text=self.terminal)

    def start(self, host, *words, text, cwd=None):
        """Start stepbus on a host, with its output in a file."""
        with text.open("wb") as output:
            pipes = {"stdout": output, "stderr": output, "cwd": cwd}
            return self.wan.start(host, *STEPBUS, *words, **pipes)

    def ticket(self, name):
        return self.folder / f"{name}.ticket"

    def join(self, *names):
        """Join participants, all of them by default, each in its host's copy of the scenario."""
        for name in names or self.hosts:
            home = self.folder / name
            shutil.copytree(_SCENARIO, home)
            path = self.ticket(name)
            assert comes_true(lambda path=path: path.exists() or self.has_ended()), "no ticket"
            self.joined[name] = home / "terminal.txt"
            self.processes[name] = self.start(
                self.hosts[name], "join", path, "--wait", "1s", text=self.joined[name], cwd=home
            )
        return self

    def has_ended(self):
        return self.orchestrator.poll() is not None

    def under_way(self, size=_ENOUGH_BYTES, *, may_end=False):
        """Wait until the run has done many steps, and has not ended."""
        recording = self.out / "run.mcap"
        there = lambda: recording.exists() and recording.stat().st_size > size  # noqa: E731
        assert comes_true(lambda: there() or self.has_ended()), self.said()
        assert may_end or not self.has_ended(), self.said()

    def said(self):
        """Return what stands in the terminals of all hosts."""
        texts = {"run": self.terminal, **self.joined}
        return "\n".join(f"--- {name}\n{path.read_text()}" for name, path in texts.items())

    def result(self):
        """Return what the run says of itself, once it has ended."""
        assert comes_true(self.has_ended, 100), self.said()
        return json.loads((self.out / "result.json").read_text())

    def within(self, seconds, *, since, but=()):
        """Fail unless within a time [s] after a moment nothing is left on any host. but: hosts."""
        hosts = [host for host in range(len(self.wan.names)) if host not in but]
        give_up = since + seconds

        def left():
            # A process of ours that has ended is a zombie until somebody asks.
            for process in (self.orchestrator, *self.processes.values()):
                process.poll()
            return {host: pids for host in hosts if (pids := self._alive(host))}

        assert comes_true(lambda: not left(), max(give_up - time.monotonic(), 0)), (
            left(),
            self.said(),
        )
        return time.monotonic() - since

    def _alive(self, host):
        found = []
        for pid in self.wan.pids(host):
            try:
                process = psutil.Process(pid)
                if not has_ended(process):
                    found.append((pid, process.status(), " ".join(process.cmdline())))
            except psutil.NoSuchProcess:
                continue
        return found

    def kill(self, name, number=signal.SIGKILL):
        """Send a signal to a participant, where it has not ended."""
        with contextlib.suppress(psutil.NoSuchProcess):
            self.processes[name].send_signal(number)
