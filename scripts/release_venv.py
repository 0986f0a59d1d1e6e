"""Install a wheel into an environment, and use it as a user does: empty home, empty folder."""

import re
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scripts.release_build import ROOT, Failed, run

INSTALL_PATIENCE_S = 1200.0
MESSAGES = re.compile(r"^messages  ([0-9a-f]{64})$", re.MULTILINE)


@dataclass(frozen=True)
class Environment:
    """A virtual environment with the wheel in it. folder: holds it, a home and working folders."""

    folder: Path

    @property
    def programs(self) -> Path:
        """Return the folder of its programs."""
        return self.folder / "env/bin"

    def run(self, *command: str, cwd: Path, patience_s: float = 300.0) -> str:
        """Return what one of its programs prints; raises Failed."""
        program, *words = command
        clean = ("env", "-i", *self._variables())
        return run(*clean, self.programs / program, *words, cwd=cwd, patience_s=patience_s)

    def _variables(self) -> list[str]:
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        path = f"{self.programs}:/usr/local/bin:/usr/bin:/bin"
        return [f"HOME={home}", f"PATH={path}", "LANG=C.UTF-8", "COLUMNS=120"]

    def work(self, name: str) -> Path:
        """Return a new, empty working folder."""
        folder = self.folder / name
        folder.mkdir(parents=True)
        return folder


def borrowed(folder: Path, wheel: Path) -> Environment:
    """Return an environment with the wheel and the dependencies of the Python that runs this.

    They are links to its packages, all but stepbus itself: that takes a second, not a minute.
    """
    target = folder / "env"
    run(sys.executable, "-m", "venv", "--without-pip", target, cwd=folder)
    ours = Path(sysconfig.get_path("purelib"))
    (site,) = target.glob("lib/python*/site-packages")
    for entry in ours.iterdir():
        if "stepbus" not in entry.name and entry.name != "__pycache__":
            (site / entry.name).symlink_to(entry)
    _pip(target / "bin/python", folder, "--no-deps", "--no-index", str(wheel))
    return Environment(folder)


def installed(folder: Path, wheel: Path, extras: str, cache: Path) -> Environment:
    """Return an empty environment with the wheel and extras, at the versions of constraints.txt.

    cache: of pip, so that several environments download a package once.
    """
    target = folder / "env"
    run(sys.executable, "-m", "venv", target, cwd=folder)
    own = target / "bin/python"
    where = f"stepbus[{extras}] @ {wheel.as_uri()}" if extras else str(wheel)
    words = ("--cache-dir", str(cache), "-c", str(ROOT / "constraints.txt"), where)
    _pip(own, folder, *words)
    run(own, "-m", "pip", "check", cwd=folder)
    return Environment(folder)


def _pip(python: Path, folder: Path, *words: str) -> None:
    command = (sys.executable, "-m", "pip", "--python", python, "install", "-q")
    run(*command, *words, cwd=folder, patience_s=INSTALL_PATIENCE_S)


def try_demo(environment: Environment, version: str, wanted: str | None) -> Iterator[str]:
    """Run what the first page promises; yield a line for each part that works; raises Failed.

    version: of the wheel. wanted: the hash of the messages of two_link; None: of any.
    """
    folder = environment.work("demo")
    assert_equal("stepbus --version", environment.run("stepbus", "--version", cwd=folder).strip(),
                 f"stepbus {version}")  # fmt: skip
    said = environment.run("stepbus", "run", "two_link", "--out", "first", cwd=folder)
    messages = hash_of(said)
    if wanted is not None:
        assert_equal("the messages of `stepbus run two_link`", messages, wanted)
    for name in ("run.mcap", "report.html", "report.png"):
        if not (folder / "first" / name).is_file():
            raise Failed(f"`stepbus run two_link` writes no {name}")
    yield f"run two_link: messages {messages[:16]}…"
    environment.run("stepbus", "new", "my_arm", cwd=folder)
    hash_of(environment.run("stepbus", "run", "my_arm", cwd=folder))
    yield "new my_arm, run my_arm"
    environment.run("stepbus", "doctor", cwd=folder)
    yield "doctor"
    left = sorted(path.name for path in folder.iterdir())
    assert_equal("the working folder", left, ["first", "my_arm", "runs"])


def hash_of(said: str) -> str:
    """Return the hash of the messages from the summary of a run; raises Failed."""
    match = MESSAGES.search(said)
    if match is None:
        raise Failed(f"the summary of the run has no line `messages`:\n{said}")
    return match[1]


def assert_equal(what: str, got: object, wanted: object) -> None:
    """Raise Failed, with both values, where they differ."""
    if got != wanted:
        raise Failed(f"{what}: {got}, expected {wanted}")
