"""A host that is reached over SSH: an sshd of the test, and a user of its own.

All is in a folder of the test, and in a mount namespace that ends with sshd: there, the user stands
in /etc/passwd, and reaches the interpreter, which may lie in the home of another one.
"""

import contextlib
import json
import os
import pwd
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from support.paths import CHECKOUT
from support.runs.distant import STEPBUS, words_of
from support.surroundings import comes_true, has_ended
from support.tools import needs

UID = 4711
USER = "robot"
PORT = 22
_CONFIG = """\
Port {port}
ListenAddress {address}
HostKey {folder}/host_key
PidFile none
UsePAM no
StrictModes no
AuthorizedKeysFile {there}/key.pub
SetEnv TMPDIR={there}/tmp
"""
_CLIENT = """\
Host *
 Port {port}
 User {user}
 IdentityFile {folder}/key
 StrictHostKeyChecking no
 UserKnownHostsFile /dev/null
 LogLevel ERROR
"""


class Robot:
    """The second host of a network as `robot`, and runs of the first that have participants there.

    folder: of the test. there: a folder that this user can enter, with its home and `tmp`.
    """

    def __init__(self, folder, there, wan):
        self.folder, self.there, self.wan = folder, there, wan
        self.tmp, self.out = there / "tmp", folder / "out"
        self.terminal, self.orchestrator = folder / "terminal.txt", None
        self.hosts = {"address": wan.addresses[1], "python": sys.executable}
        names = {"folder": folder, "there": there, "port": PORT, "user": USER}
        (folder / "sshd_config").write_text(_CONFIG.format(address=wan.addresses[1], **names))
        (folder / "ssh_config").write_text(_CLIENT.format(**names))
        for key in ("key", "host_key"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / key]
            subprocess.run(command, check=True, timeout=60)
        shutil.copy(folder / "key.pub", there)
        for home in (there / "home", self.tmp):
            home.mkdir()
            os.chown(home, UID, UID)
        known = "".join(f"{':'.join(map(str, one))}\n" for one in pwd.getpwall())
        known += f"{USER}:*:{UID}:{UID}::{there}/home:/bin/sh\n"
        (folder / "passwd").write_text(known)
        self._log = folder / "sshd.log"
        with self._log.open("wb") as log:
            command = ("unshare", "-m", "sh", "-ec", self._script())
            self._sshd = wan.start(1, *command, stdout=log, stderr=log)
        listens = lambda: "Server listening" in self._log.read_text()  # noqa: E731
        assert comes_true(listens), self._log.read_text()

    def _script(self):
        """Return the commands that start sshd where the user can reach what it has to start."""
        lines = [f"mount --bind {self.folder}/passwd /etc/passwd"]
        lines += ["mount -t tmpfs -o mode=755 none /run", "mkdir /run/sshd"]
        home, kept = Path.home(), {Path(sys.base_prefix).resolve(), Path(sys.prefix), CHECKOUT}
        below = [path for path in sorted(kept) if path.is_relative_to(home)]
        for number, path in enumerate(below):
            lines += [f"mkdir {self.folder}/kept{number}"]
            lines += [f"mount --bind {path} {self.folder}/kept{number}"]
        lines += [f"mount -t tmpfs -o mode=755 none {home}"] if below else []
        for number, path in enumerate(below):
            lines += [f"mkdir -p {path}", f"mount --bind {self.folder}/kept{number} {path}"]
        sshd = shutil.which("sshd") or "/usr/sbin/sshd"
        return "\n".join([*lines, f"exec {sshd} -D -e -f {self.folder}/sshd_config"])

    def start(self, *settings, names=("controller",), **changed):
        """Start a run of two_link with participants on `robot`. changed: entries of its hosts file."""
        spec = {**self.hosts, "ssh": ["-F", f"{self.folder}/ssh_config"], **changed}
        (self.folder / "hosts.yaml").write_text(json.dumps({USER: spec}))
        words = ["run", "two_link", "--hosts", self.folder / "hosts.yaml", "--out", self.out]
        words += ["--no-report", *words_of([f"{name}.host={USER}" for name in names])]
        command = (*STEPBUS, *words, *words_of(settings))
        with self.terminal.open("wb") as output:
            self.orchestrator = self.wan.start(0, *command, stdout=output, stderr=output)
        return self

    def under_way(self, size=50_000):
        """Wait until the run has done many steps."""
        recording = self.out / "run.mcap"
        there = lambda: recording.exists() and recording.stat().st_size > size  # noqa: E731
        assert comes_true(lambda: there() or self.has_ended()), self.said()
        assert not self.has_ended(), self.said()
        return self

    def close(self):
        """End all on both hosts."""
        for pid in (*self.wan.pids(0), *self.wan.pids(1)):
            # It may have ended meanwhile.
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._sshd.wait(20)

    def has_ended(self):
        return self.orchestrator.poll() is not None

    def result(self):
        """Return what the run says of itself, once it has ended."""
        assert comes_true(self.has_ended, 100), self.said()
        return json.loads((self.out / "result.json").read_text())

    def said(self):
        return f"{self.terminal.read_text()}\n--- sshd\n{self._log.read_text()}"

    def processes(self, word=""):
        """Return the processes of this user on this host, with a word in their command line."""
        found = []
        for pid in self.wan.pids(1):
            try:
                process = psutil.Process(pid)
                is_ours = process.uids().real == UID and not has_ended(process)
                if is_ours and word in shlex.join(process.cmdline()):
                    found.append(process)
            except psutil.NoSuchProcess:
                continue
        return found

    def is_empty(self, seconds):
        """Return whether nothing of the run is left here within a time [s]."""
        return comes_true(lambda: not self.processes() and not list(self.tmp.iterdir()), seconds)


@pytest.fixture
def robot(tmp_path, own_temp, wan):
    """Return a host that is reached over SSH; it ends with the network."""
    needs("ssh", "ssh-keygen", "unshare", "mount")
    if shutil.which("sshd") is None and not Path("/usr/sbin/sshd").exists():
        pytest.skip("sshd is not installed")
    own_temp.chmod(0o711)
    there = own_temp / "there"
    there.mkdir(mode=0o711)
    made = Robot(tmp_path, there, wan(2))
    yield made
    made.close()
    shutil.rmtree(there)
