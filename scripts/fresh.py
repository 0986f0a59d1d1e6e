"""Run the README's two commands as a stranger's machine would: an empty clone, nothing installed.

    make fresh                          clone HEAD, run the commands at the top of README.md
    make fresh FRESH='--order 7'        with the tests in another order
    make fresh FRESH='--passed FILE'    write the passed tests to this file, for make test-rest

The machine that it makes up has Python, make, git, the coreutils, sh, grep, sed, awk and tar: no
compiler, no Node, Java, Octave, Perl. The home is empty, the environment too, but for what pip
needs to reach its registry. Started as root, the commands run as another user. The tests come in a
shuffled order; which one follows from the commit, so that a commit has one verdict.

It fails where a command fails, and where a process is left.
"""

import argparse
import contextlib
import ctypes
import os
import pwd
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COREUTILS = (
    "arch b2sum base32 base64 basename basenc cat chgrp chmod chown chroot cksum comm cp csplit cut"
    " date dd df dir dircolors dirname du echo env expand expr factor false fmt fold groups head"
    " hostid id install join link ln logname ls md5sum mkdir mkfifo mknod mktemp mv nice nl nohup"
    " nproc numfmt od paste pathchk pinky pr printenv printf ptx pwd readlink realpath rm rmdir"
    " runcon seq sha1sum sha224sum sha256sum sha384sum sha512sum shred shuf sleep sort split stat"
    " stdbuf stty sum sync tac tail tee test timeout touch tr true truncate tsort tty uname"
    " unexpand uniq unlink users vdir wc who whoami yes ["
)
PROGRAMS = ("sh", "grep", "sed", "awk", "tar", "git", "make", *COREUTILS.split())
PASSED_ON = re.compile(
    r"(PIP_.*|SSL_CERT_(FILE|DIR)|REQUESTS_CA_BUNDLE|(https?|no|all)_proxy)", re.IGNORECASE
)
"""The variables that a registry's client needs."""
OWN_USER = 61_000
"""Users of its own have numbers from here to 64,999, of which Debian gives out none."""
PATIENCE_S = 60.0
"""How long a process may take to end after the command that started it."""
CHILDREN = Path(f"/proc/self/task/{os.getpid()}/children")
PYTHON = (3, 11)
"""The version that has PyBullet, and so all tests."""


class Unfit(Exception):
    """Something is missing here that every machine is assumed to have."""


@dataclass
class Machine:
    """A made-up machine: where its folders are and who works on it."""

    folder: Path
    uid: int
    gid: int

    def __post_init__(self) -> None:
        """Name its folders: home, temporary files, programs (its whole PATH), the checkout."""
        self.home, self.temporary = self.folder / "home", self.folder / "tmp"
        self.programs, self.checkout = self.folder / "bin", self.folder / "stepbus"
        self.passed = self.folder / "passed"

    def environment(self) -> dict[str, str]:
        """Return all variables that a command sees."""
        passed_on = {name: v for name, v in os.environ.items() if PASSED_ON.fullmatch(name)}
        name = user_name(self.uid)
        own = {"HOME": str(self.home), "PATH": str(self.programs), "TMPDIR": str(self.temporary)}
        return passed_on | own | {"USER": name, "LOGNAME": name}

    def run(self, command: str, **variables: str) -> int:
        """Run a command of the README in the checkout, as the machine's user; return its code."""
        process = subprocess.Popen(
            ["sh", "-c", command],
            executable=str(self.programs / "sh"),
            cwd=self.checkout,
            env=self.environment() | variables,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            **self.identity(),
        )
        return exit_code(process.pid)

    def identity(self) -> dict[str, object]:
        """Return what makes a child of ours one of the machine's user."""
        if self.uid == os.getuid():
            return {"umask": 0o022}
        return {"user": self.uid, "group": self.gid, "extra_groups": [], "umask": 0o022}


def exit_code(pid: int) -> int:
    """Wait for a child and return its exit code; fetch those of orphans, which come to us."""
    while True:
        ended, status = os.wait()
        if ended == pid:
            return os.waitstatus_to_exitcode(status)


def user_name(uid: int) -> str:
    """Return the name of a user; one of our own has none on this machine."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return "stranger"


def whose() -> tuple[int, int]:
    """Return the user and group that the commands run as."""
    if os.getuid() != 0:
        return os.getuid(), os.getgid()
    taken = {entry.pw_uid for entry in pwd.getpwall()}
    first = OWN_USER + os.getpid() % 3_000  # another run beside this one has another
    uid = next(n for n in range(first, 65_000) if n not in taken)
    return uid, uid


def suitable_python(machine: Machine) -> Path:
    """Return a Python with `venv` that the machine's user may execute."""
    test = f"import ensurepip, sys; sys.exit(sys.version_info[:2] != {PYTHON})"
    identity = machine.identity()
    for place in dict.fromkeys([*os.get_exec_path(), "/usr/local/bin", "/usr/bin"]):
        for path in (Path(place, "python3.11"), Path(place, "python3")):
            with contextlib.suppress(OSError, subprocess.CalledProcessError):
                streams = {"env": machine.environment(), "cwd": "/", "stderr": subprocess.DEVNULL}
                subprocess.run([path, "-c", test], check=True, **streams, **identity)
                return path.resolve()
    wanted = ".".join(map(str, PYTHON))
    raise Unfit(
        f"no Python {wanted} with venv that {user_name(machine.uid)} may execute is on PATH"
    )


def build(machine: Machine) -> None:
    """Make the machine's folders, its programs and the checkout of HEAD."""
    machine.folder.chmod(0o755)
    for folder in (machine.home, machine.temporary, machine.programs):
        folder.mkdir()
    for name in PROGRAMS:
        if (path := shutil.which(name)) is not None:
            (machine.programs / name).symlink_to(Path(path).resolve())
    (machine.programs / "python3").symlink_to(suitable_python(machine))
    clone = ["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(machine.checkout)]
    subprocess.run(clone, check=True)
    machine.passed.touch()
    own = (machine.home, machine.temporary, machine.passed, machine.checkout)
    for path in (*own, *machine.checkout.rglob("*")):
        os.chown(path, machine.uid, machine.gid, follow_symlinks=False)


def commands_of_the_readme() -> list[str]:
    """Return the commands of the first block of README.md."""
    match = re.search(
        r"^```\n(.*?)^```$", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    )
    assert match is not None, "README.md must begin with the commands"
    return match[1].splitlines()


def processes_left() -> list[str]:
    """Wait for processes to end; end those that do not, and return what they were.

    All are children of this process: it inherits those whose parents have ended.
    """
    end, named = time.monotonic() + PATIENCE_S, []
    with contextlib.suppress(ChildProcessError):
        while True:
            if os.waitpid(-1, os.WNOHANG) != (0, 0):
                continue
            if time.monotonic() > end:
                named += [ended(pid) for pid in CHILDREN.read_text().split()]
            time.sleep(0.1)
    return named


def ended(pid: str) -> str:
    """Kill a child; return what it was."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    os.kill(int(pid), signal.SIGKILL)
    return f"process {pid}: {' '.join(words)[:200]}"


def try_out(machine: Machine, order: int) -> list[str]:
    """Run the commands and return what is wrong."""
    for command in commands_of_the_readme():
        began = time.monotonic()
        options = f"--random-order-seed={order} --passed-to={machine.passed}"
        code = machine.run(command, PYTEST_ADDOPTS=options)
        say(f"fresh: {command}: exit code {code} after {time.monotonic() - began:.0f} s")
        wrong = [] if code == 0 else [f"exit code {code}"]
        wrong += processes_left()
        if wrong:
            return [f"after {command}: {text}" for text in wrong]
    return []


def say(line: str) -> None:
    """Print a line at once: the commands print to the same place."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def examine(order: int | None, passed: Path | None) -> tuple[list[str], str]:
    """Build a machine and run the commands there; return what is wrong, and what was tried."""
    command = ["git", "rev-parse", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    head = done.stdout.strip()
    order = int(head[:8], 16) if order is None else order
    if ctypes.CDLL(None).prctl(36, 1, 0, 0, 0):  # PR_SET_CHILD_SUBREAPER
        raise Unfit("this kernel has no subreapers, so leftover processes cannot be found")
    folder = Path(tempfile.mkdtemp(prefix="sb-fresh-"))
    try:
        machine = Machine(folder, *whose())
        build(machine)
        whom = f"{user_name(machine.uid)} ({machine.uid})"
        about = f"a clone of {head[:10]}, order {order}, as {whom}"
        say(f"fresh: {about}, in {folder}")
        wrong = try_out(machine, order)
        if passed is not None:
            shutil.copyfile(machine.passed, passed)
        return wrong, about
    finally:
        processes_left()
        shutil.rmtree(folder)


def main() -> int:
    """Run the commands, print the verdict, and return 1 where it is bad."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--order", type=int, metavar="N", help="seed of the order of the tests")
    parser.add_argument(
        "--passed", type=Path, metavar="FILE", help="write the passed tests to this file"
    )
    args = parser.parse_args()
    try:
        wrong, about = examine(args.order, args.passed)
    except Unfit as exc:
        wrong, about = [str(exc)], "not run"
    for line in wrong:
        say(f"fresh: {line}")
    say(f"fresh: {'FAILED' if wrong else 'passed'}: {about}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
