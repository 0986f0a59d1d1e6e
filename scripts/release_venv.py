"""Install a wheel into an environment, and use it as a user does: empty home, empty folder."""

import re
import signal
import subprocess
import sys
import sysconfig
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.cookiejar import CookieJar
from pathlib import Path
from urllib.parse import urljoin

from scripts.release_build import ROOT, Failed, run

INSTALL_PATIENCE_S = 1200.0
PAGE_PATIENCE_S = 60.0
ADDRESS = re.compile(r"http://(?:localhost|127\.0\.0\.1):\d+/\S*")
REFRESH = re.compile(r'http-equiv="refresh" content="0; url=([^"]+)"')
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

    @contextmanager
    def started(self, *command: str, cwd: Path) -> Iterator[subprocess.Popen[str]]:
        """Start a program, and end it with Ctrl-C; raises Failed where that does not work."""
        process = subprocess.Popen(
            ["env", "-i", *self._variables(), str(self.programs / command[0]), *command[1:]],
            cwd=cwd,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        try:
            yield process
            process.send_signal(signal.SIGINT)
            code = process.wait(PAGE_PATIENCE_S)
        except subprocess.TimeoutExpired:
            text = f"does not end {PAGE_PATIENCE_S:g} s after Ctrl-C"
            raise Failed(f"`{' '.join(command)}` {text}") from None
        finally:
            process.kill()
            process.wait()
        if code not in (0, 130):
            raise Failed(f"`{' '.join(command)}` ends with exit code {code} after Ctrl-C")


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
    yield f"view: {try_view(environment, folder, 'first')}"
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


def try_view(environment: Environment, folder: Path, recording: str) -> str:
    """Open the page of a recording as a browser does, and end it; return its title."""
    command = ("stepbus", "view", recording, "--no-open")
    with environment.started(*command, cwd=folder) as process:
        assert process.stdout is not None
        said = ""
        for line in process.stdout:
            said += line
            if match := ADDRESS.search(line):
                break
        else:
            raise Failed(f"`{' '.join(command)}` prints no address:\n{said}")
        page = fetched(match[0])
    title = re.search(r"<title>(.*?)</title>", page)
    if title is None or "stepbus" not in title[1]:
        raise Failed(f"the page of `{' '.join(command)}` has no title of ours")
    return f"{len(page) // 1000} kB, {title[1]}"


def fetched(address: str) -> str:
    """Return a page that an address with a token leads to; raises Failed."""
    handlers = (urllib.request.ProxyHandler({}), urllib.request.HTTPCookieProcessor(CookieJar()))
    browser = urllib.request.build_opener(*handlers)
    end_s = time.monotonic() + PAGE_PATIENCE_S
    while True:
        try:
            with browser.open(address, timeout=PAGE_PATIENCE_S) as answer:
                text: str = answer.read().decode()
        except (OSError, urllib.error.URLError) as exc:
            raise Failed(f"{address} does not answer: {exc}") from exc
        if (match := REFRESH.search(text)) is None:
            return text
        if time.monotonic() > end_s:
            raise Failed(f"{address} leads from page to page without end")
        address = urljoin(address, match[1])
