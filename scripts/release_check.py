"""Build a release and try it as its users will; nothing is published.

    make release-check                              all parts, in this order (about 20 min)
    make release-check RELEASE='--only build'       only a part; may be repeated
    make release-check RELEASE=--quick              build and demo (1 min)
    make release-check RELEASE='--only extras --extra view'   only one of the extras
    make release-check RELEASE='--tag v0.2.0 --out dist'      also: the tag fits; keep the files

    build     wheel and sdist of HEAD, and the wheel from the sdist: the same bytes, every file that
              a package needs; versions agree, `twine check --strict`
    demo      the wheel, with the dependencies of this environment: run, new, doctor
    extras    the wheel and each extra in an empty environment, from the registry of pip
    docs      the examples of the pages, against the wheel

It builds what is committed. SOURCE_DATE_EPOCH is the time of that commit.
"""

import argparse
import re
import shlex
import shutil
import sys
import sysconfig
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

from scripts.release_dist import ROOT, Failed, Layout, build, check_out, run, sha256, tracked_files

PROJECTS = (".", "store")
USES = ROOT / "scripts/release_uses"
EXTRAS = tomllib.loads((USES / "extras.toml").read_text())
"""Extra → `run`: commands in a folder with `USES` and a recording, `run.mcap`; `writes`: what
comes of them."""
RECORDING = ROOT / "tests/scenarios/golden/two_link.mcap"
MESSAGES = re.compile(r"^messages  ([0-9a-f]{64})$", re.MULTILINE)
HASHES = {
    "pybullet": (MESSAGES, ((3, 11),)),
    "mujoco": (re.compile(r"^`([0-9a-f]{64})`\.$", re.MULTILINE), ((3, 11), (3, 12), (3, 13))),
}
"""Engine → the line of README.md with the hash of its messages, and the Pythons that it is for."""
LONG_S = 1800.0


class Environment:
    """A virtual environment and an empty home in a folder, in which a user works."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.programs = folder, folder / "env/bin"
        (folder / "home").mkdir(parents=True)
        run(sys.executable, "-m", "venv", "--without-pip", folder / "env", cwd=folder)

    def pip(self, *words: str | Path) -> None:
        """Install into it with the pip of this Python."""
        pip = (sys.executable, "-m", "pip", "--python", self.programs / "python")
        run(*pip, "install", "-q", *words, cwd=self.folder, patience_s=LONG_S)
        if "--no-deps" not in words:
            run(*pip, "check", cwd=self.folder)

    def borrow(self, wheel: Path) -> None:
        """Install a wheel and link the packages of this Python, which takes a second."""
        (site,) = (self.folder / "env").glob("lib/python*/site-packages")
        for entry in Path(sysconfig.get_path("purelib")).iterdir():
            if "stepbus" not in entry.name and entry.name != "__pycache__":
                (site / entry.name).symlink_to(entry)
        name = "graphviz-pure"
        (self.programs / name).symlink_to(Path(sysconfig.get_path("scripts")) / name)
        self.pip("--no-deps", "--no-index", wheel)

    def run(self, command: str, cwd: Path, patience_s: float = 300.0) -> str:
        """Return what one of its programs prints; raises Failed."""
        program, *words = shlex.split(command)
        path = f"PATH={self.programs}:/usr/local/bin:/usr/bin:/bin"
        variables = (f"HOME={self.folder}/home", "LANG=C.UTF-8", "COLUMNS=120", path)
        line = ("env", "-i", *variables, self.programs / program, *words)
        return run(*line, cwd=cwd, patience_s=patience_s)


class Release:
    """The release of HEAD. folder: temporary. options: of the command line."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        self.folder, self.options = folder, options
        self.commit, self.epoch = run("git", "log", "-1", "--format=%H %ct", cwd=ROOT).split()
        self.files = tracked_files(self.commit)
        self.version = Layout(self.files).version
        self.built: list[Path] = []
        say(f"commit {self.commit[:10]}, SOURCE_DATE_EPOCH {self.epoch}, in {folder}")

    @property
    def wheel(self) -> Path:
        """Return the wheel of stepbus."""
        return self.built[1]

    def build(self) -> Iterator[str]:
        """Build each project; yield what is wrong with its files, version and metadata."""
        for project in PROJECTS:
            place = self.folder / "built" / Layout(self.files, project).name
            sdist, wheel, problems = build(self.files, place, self.epoch, project)
            self.built += [sdist, wheel]
            yield from problems
            if self.version not in wheel.name:
                yield f"{wheel.name} is not of version {self.version}"
        for file in self.built:
            say(f"build: {file.name}, {file.stat().st_size:,} bytes, sha256 {sha256(file)}")
        if self.options.tag is not None:
            changelog = self.files["CHANGELOG.md"].decode()
            yield from problems_of_tag(self.options.tag, self.version, changelog)
        run(sys.executable, "-m", "twine", "--no-color", "check", "--strict", *self.built, cwd=ROOT)

    def demo(self) -> Iterator[str]:
        """Do what the first page promises, with the packages of this environment."""
        environment = Environment(self.folder / "demo")
        environment.borrow(self.wheel)
        (folder := self.folder / "demo/work").mkdir()
        said = environment.run("stepbus --version", folder).strip()
        if said != f"stepbus {self.version}":
            yield f"stepbus --version prints {said}"
        messages = hash_of(environment.run("stepbus run two_link --out first", folder))
        wanted = None if self.options.any_arithmetic else wanted_hash()
        if wanted not in (None, messages):
            yield f"the messages of `stepbus run two_link`: {messages}, expected {wanted}"
        for name in ("run.mcap", "report.html", "report.png"):
            if not (folder / "first" / name).is_file():
                yield f"`stepbus run two_link` writes no {name}"
        environment.run("stepbus new my_arm", folder)
        hash_of(environment.run("stepbus run my_arm", folder))
        environment.run("stepbus doctor", folder)
        if (left := sorted(path.name for path in folder.iterdir())) != ["first", "my_arm", "runs"]:
            yield f"the working folder has {left}"

    def extras(self) -> Iterator[str]:
        """Install each extra into an empty environment and use it; yield those that fail."""
        for name in self.options.extra or EXTRAS:
            began, place = time.monotonic(), self.folder / f"extra-{name}"
            try:
                self._try_extra(name, place)
            except Failed as exc:
                yield f"extra {name}: {exc}"
            say(f"extras: {name}: {time.monotonic() - began:.0f} s")
            shutil.rmtree(place)  # ten environments would need 5 GB

    def _try_extra(self, name: str, place: Path) -> None:
        environment, use = Environment(place), EXTRAS[name]
        extra = "" if name == "none" else f"[{name}]"
        cache = ("--cache-dir", self.folder / "pip", "-c", ROOT / "constraints.txt")
        environment.pip(*cache, f"stepbus{extra} @ {self.wheel.as_uri()}")
        folder = shutil.copytree(USES, place / "work")
        shutil.copy(RECORDING, folder / "run.mcap")
        for command in use["run"]:
            environment.run(command, folder)
        for written in use.get("writes", ()):
            path = folder / written
            if not path.exists() or (path.is_file() and not path.stat().st_size):
                raise Failed(f"{written} was not written")

    def docs(self) -> Iterator[str]:
        """Run the tests of the pages' examples in a checkout, where `stepbus` is the wheel."""
        environment = Environment(self.folder / "docs")
        environment.borrow(self.wheel)
        clone = check_out(self.files, self.folder / "docs/clone")
        program = "import stepbus, sys; sys.exit(not stepbus.__file__.startswith(sys.prefix))"
        environment.run(f"python -c {shlex.quote(program)}", clone)
        pytest = "python -m pytest tests/docs/test_examples.py -k page -n 2 -m 'slow or not slow'"
        said = environment.run(pytest, clone, LONG_S)
        say(f"docs: {said.strip().splitlines()[-1].strip('= ')}")
        yield from ()

    def keep(self, out: Path) -> None:
        """Copy the files that were checked into a folder, with their hashes in SHA256SUMS."""
        names = {file: f"{file.parents[1].name}/{file.name}" for file in self.built}
        for file, name in names.items():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, out / name)
        sums = "".join(f"{sha256(file)}  {name}\n" for file, name in names.items())
        (out / "SHA256SUMS").write_text(sums)
        say(f"{len(names)} files and SHA256SUMS in {out}")


PARTS: dict[str, Callable[[Release], Iterator[str]]] = {
    "build": Release.build,
    "demo": Release.demo,
    "extras": Release.extras,
    "docs": Release.docs,
}
QUICK = ["build", "demo"]


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"release: {line}\n")
    sys.stdout.flush()


def problems_of_tag(tag: str, version: str, changelog: str) -> Iterator[str]:
    """Yield what does not fit a tag: the version, or the changelog that has no such section."""
    if tag != f"v{version}":
        yield f"the tag {tag} is not v{version}, the version of pyproject.toml"
    if not re.search(rf"^## {re.escape(version)}\b", changelog, re.MULTILINE):
        yield f"CHANGELOG.md has no section `## {version}`"


def hash_of(said: str, pattern: re.Pattern[str] = MESSAGES) -> str:
    """Return the hash of the messages from the summary of a run; raises Failed."""
    match = pattern.search(said)
    if match is None:
        raise Failed(f"no hash of messages in:\n{said}")
    return match[1]


def wanted_hash() -> str | None:
    """Return the hash of two_link's messages that README.md shows; None: of no such Python."""
    pattern, pythons = HASHES["pybullet" if find_spec("pybullet") else "mujoco"]
    page = (ROOT / "README.md").read_text()
    return hash_of(page, pattern) if sys.version_info[:2] in pythons else None


def examine(options: argparse.Namespace, folder: Path) -> list[str]:
    """Make all checks that are wanted, and return what is wrong; stop where nothing is built."""
    release, problems = Release(folder, options), []
    for name, check in PARTS.items():
        if name != "build" and options.only and name not in options.only:
            continue
        began = time.monotonic()
        try:
            wrong = list(check(release))
        except Failed as exc:
            wrong = [str(exc)]
        problems += [f"{name}: {line}" for line in wrong]
        say(f"{name}: {'FAILED' if wrong else 'passed'} after {time.monotonic() - began:.0f} s")
        if len(release.built) < 2 * len(PROJECTS):
            break
    if options.out is not None and not problems:
        release.keep(options.out)
    return problems


def main() -> int:
    """Make the checks and print the verdict; return 1 where something is wrong."""
    parser = argparse.ArgumentParser(
        prog="make release-check",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", action="append", choices=PARTS, help="this part; may be repeated")
    text = f"the same as --only for {', '.join(QUICK)}"
    parser.add_argument("--quick", dest="only", action="store_const", const=QUICK, help=text)
    parser.add_argument("--extra", action="append", choices=EXTRAS, help="of these extras")
    parser.add_argument("--tag", metavar="vX.Y.Z", help="check that the tag fits the version")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="keep the files that passed")
    text = "do not compare with the hash of README.md: another processor may give another one"
    parser.add_argument("--any-arithmetic", action="store_true", help=text)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="sb-release-", ignore_cleanup_errors=True) as folder:
        try:
            problems = examine(options, Path(folder))
        except Failed as exc:
            problems = [str(exc)]
    for line in problems:
        say(line)
    parts = ", ".join(options.only) if options.only else "all parts"
    say(f"{f'FAILED, {len(problems)} problems' if problems else 'passed'}: {parts}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
