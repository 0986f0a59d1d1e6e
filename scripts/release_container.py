"""Carry out the Containerfile without a container engine, in a copy-on-write view of this machine.

    make container-check        as root; needs unshare, chroot and the file system overlay

Each stage gets a view of its own, whose base is this machine with this Python as `python`, in place
of the image of FROM. COPY takes what is committed. Then it runs `stepbus run two_link` by the entry
point, as the user of the image. Nothing of it stays. What the base image lacks and this machine
has, such as a library, is not found this way: only an engine shows that.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scripts.release_build import ROOT, Failed, Timer, check_out, commit_of_head, tracked_files

KNOWN = ("FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "ENTRYPOINT", "CMD")
PASSED_ON = re.compile(r"PIP_.*|SSL_CERT_(FILE|DIR)|(https?|no|all)_proxy", re.IGNORECASE)
PATIENCE_S = 1500.0
LAST_LINES = 15
DEMO = ("run", "two_link", "--out", "runs/first")


@dataclass
class Stage:
    """One stage of a Containerfile: what follows a FROM."""

    base: str
    name: str
    steps: list[tuple[str, str]] = field(default_factory=list)

    def last(self, instruction: str) -> str:
        """Return the argument of the last such instruction; empty where there is none."""
        return next((text for name, text in reversed(self.steps) if name == instruction), "")


def stages(text: str) -> list[Stage]:
    """Return the stages of a Containerfile; raises Failed for what we cannot carry out."""
    parsed: list[Stage] = []
    for line in re.sub(r"\\\n\s*", " ", text).splitlines():
        instruction, _, rest = line.strip().partition(" ")
        if not instruction or instruction.startswith("#"):
            continue
        if instruction not in KNOWN or not (parsed or instruction == "FROM"):
            raise Failed(f"Containerfile: cannot carry out `{line.strip()}`")
        if instruction == "FROM":
            base, _, name = rest.partition(" AS ")
            parsed.append(Stage(base, name))
        else:
            parsed[-1].steps.append((instruction, rest.strip()))
    return parsed


def sources(stage: Stage) -> Iterator[str]:
    """Yield the paths of the repository that a stage copies."""
    for instruction, text in stage.steps:
        if instruction == "COPY" and not text.startswith("--from="):
            yield from shlex.split(text)[:-1]


class View:
    """A copy-on-write view of this machine. folder: keeps what is written there."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "root"
        for path in (self.root, folder / "upper", folder / "work"):
            path.mkdir(parents=True)
        layers = f"lowerdir=/,upperdir={folder / 'upper'},workdir={folder / 'work'}"
        command = ["mount", "-t", "overlay", "overlay", "-o", layers, str(self.root)]
        _checked(subprocess.run(command, check=False, capture_output=True, text=True), command)
        proc = ["mount", "-t", "proc", "proc", str(self.root / "proc")]
        _checked(subprocess.run(proc, check=False, capture_output=True, text=True), proc)
        for place in ("dev", "sys", "etc/resolv.conf", "etc/hosts"):
            target = self.root / place
            if Path("/", place).exists():
                command = ["mount", "--rbind", f"/{place}", str(target)]
                subprocess.run(command, check=False, capture_output=True)
        self._give_python()

    def _give_python(self) -> None:
        """Make `python` this Python, in a folder that every user of the view may enter."""
        python = Path(sys.executable).resolve()
        program = self.root / "usr/local/bin/python"
        program.unlink(missing_ok=True)
        # No link: an environment that is made with one takes the folder of the link for its base.
        program.write_text(f'#!/bin/sh\nexec {python} "$@"\n')
        program.chmod(0o755)
        for folder in python.parents:
            place = self.root / folder.relative_to("/")
            place.chmod(place.stat().st_mode | 0o055)

    def run(
        self, words: Sequence[str], user: str, folder: str, variables: Mapping[str, str]
    ) -> str:
        """Return what a command in the view prints; raises Failed."""
        own = ("--userspec", f"{user}:{user}") if user else ()
        given = [f"{name}={value}" for name, value in variables.items()]
        script = f"cd {shlex.quote(folder)} && exec {shlex.join(['env', '-i', *given, *words])}"
        command = ["chroot", *own, str(self.root), "/bin/sh", "-c", script]
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=PATIENCE_S
        )
        return _checked(done, list(words))


def _checked(done: subprocess.CompletedProcess[str], words: Sequence[str]) -> str:
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-LAST_LINES:])
        raise Failed(f"`{shlex.join(words)}` ends with exit code {done.returncode}:\n{last}")
    return done.stdout


def carry_out(stage: Stage, view: View, clone: Path, earlier: Mapping[str, View]) -> None:
    """Carry out the instructions of a stage in its view, one line of output for each RUN."""
    place = Place({n: v for n, v in os.environ.items() if PASSED_ON.fullmatch(n)})
    for instruction, text in stage.steps:
        if instruction == "RUN":
            timer = Timer()
            view.run(["/bin/sh", "-c", text], place.user, place.folder, place.variables)
            say(f"RUN {text[:70]}… {timer}" if len(text) > 70 else f"RUN {text}, {timer}")
        elif instruction == "COPY":
            copy(text, view, place.folder, clone, earlier)
        else:
            place.change(instruction, text)
            (view.root / place.folder.lstrip("/")).mkdir(parents=True, exist_ok=True)
    if stage.last("ENTRYPOINT"):
        words = [*json.loads(stage.last("ENTRYPOINT")), *DEMO]
        said = view.run(words, place.user, place.folder, place.variables)
        who = view.run(["id", "-un"], place.user, place.folder, place.variables).strip()
        match = re.search(r"^messages  (\w+)$", said, re.MULTILINE)
        if match is None or who == "root":
            raise Failed(f"the entry point, as {who}, prints no hash:\n{said}")
        say(f"{shlex.join(words)}, as {who}: messages {match[1][:16]}…")


class Place:
    """Where and as whom an instruction is carried out."""

    def __init__(self, variables: dict[str, str]) -> None:
        self.user, self.folder = "", "/"
        path = "/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin"
        self.variables = {"PATH": path, "HOME": "/root", **variables}

    def change(self, instruction: str, text: str) -> None:
        """Take WORKDIR, USER or ENV to heart."""
        if instruction == "WORKDIR":
            self.folder = text
        elif instruction == "USER":
            self.user = text
            self.variables["HOME"] = f"/home/{text}"
        elif instruction == "ENV":
            name, _, value = text.partition("=")
            self.variables[name] = value.replace("$PATH", self.variables["PATH"])


def copy(text: str, view: View, folder: str, clone: Path, earlier: Mapping[str, View]) -> None:
    """Carry out a COPY, from the checkout or from the view of an earlier stage."""
    words = shlex.split(text)
    base = clone
    if words[0].startswith("--from="):
        base = earlier[words.pop(0).removeprefix("--from=")].root
    *names, target = words
    end = (
        view.root / (folder.lstrip("/") if not target.startswith("/") else "") / target.lstrip("/")
    )
    for name in names:
        source = base / name.lstrip("/")
        if source.is_dir():
            shutil.copytree(source, end, symlinks=True, dirs_exist_ok=True)
        else:
            end.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, end)


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"container: {line}\n")
    sys.stdout.flush()


def examine(folder: Path) -> None:
    """Carry out all stages; raises Failed."""
    commit, _ = commit_of_head()
    clone = check_out(tracked_files(commit), folder / "clone", is_littered=False)
    earlier: dict[str, View] = {}
    for number, stage in enumerate(stages((ROOT / "Containerfile").read_text())):
        say(f"FROM {stage.base}: this machine instead")
        view = View(folder / f"stage{number}")
        earlier[stage.name] = view
        carry_out(stage, view, clone, earlier)


def main() -> int:
    """Carry out the Containerfile in a mount namespace of our own; return 1 where that fails."""
    if os.geteuid() != 0:
        say("FAILED: only root can make a view of this machine")
        return 1
    if "--inside" not in sys.argv:
        folder = tempfile.mkdtemp(prefix="sb-container-")
        own = [sys.executable, "-m", "scripts.release_container", "--inside", folder]
        command = ["unshare", "--mount", "--pid", "--fork", "--kill-child", *own]
        code = subprocess.run(command, check=False, cwd=ROOT).returncode
        shutil.rmtree(folder)
        return code
    timer = Timer()
    try:
        examine(Path(sys.argv[-1]))
    except (Failed, OSError) as exc:
        say(str(exc))
        say(f"FAILED, {timer}")
        return 1
    say(f"passed, {timer}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
