"""Build a release and try it as its users will; nothing is published.

    make release-check                              all parts, in this order (about 20 min)
    make release-check RELEASE='--only build'       only a part; may be repeated
    make release-check RELEASE=--quick              build, metadata, contents and demo (1 min)
    make release-check RELEASE='--only extras --extra view'   only one of the extras
    make release-check RELEASE='--tag v0.2.0 --out dist'      also: the tag fits; keep the files

    build     wheel and sdist of HEAD, and the wheel from the sdist: the same bytes
    metadata  versions agree, `twine check --strict`
    contents  every file that a package needs, and no other
    demo      the wheel, with the dependencies of this environment: run, new, doctor
    extras    the wheel and each extra in an empty environment, from the registry of pip
    docs      the examples of the pages, against the wheel

It builds what is committed. SOURCE_DATE_EPOCH is the time of that commit.
"""

import argparse
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from scripts.release_build import (
    ROOT,
    Built,
    Failed,
    Timer,
    build_twice,
    check_out,
    commit_of_head,
    differences,
    run,
    sha256,
    tracked_files,
)
from scripts.release_contents import Layout, problems_of_sdist, problems_of_wheel
from scripts.release_extras import EXTRAS, try_extra
from scripts.release_venv import borrowed, try_demo

PARTS = ("build", "metadata", "contents", "demo", "extras", "docs")
QUICK = PARTS[:4]
PROJECTS = {"stepbus": ".", "stepbus-store": "store"}
HASHES = {
    "pybullet": (r"^messages  ([0-9a-f]{64})$", ((3, 11),)),
    "mujoco": (r"^`([0-9a-f]{64})`\.$", ((3, 11), (3, 12), (3, 13))),
}
"""Engine → the line of README.md with the hash of its messages, and the Pythons that it is for."""
DOCS_PATIENCE_S = 1800.0


@dataclass(frozen=True)
class Release:
    """A release under test. folder: temporary. files: path → content of the commit's files."""

    folder: Path
    commit: str
    epoch: str
    files: dict[str, bytes]
    built: dict[str, Built]

    @property
    def wheel(self) -> Path:
        """Return the wheel of stepbus."""
        return self.built["stepbus"].wheel

    def layout(self, name: str) -> Layout:
        """Return the expected contents of a project's distributions."""
        return Layout(self.files, PROJECTS[name])


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"release: {line}\n")
    sys.stdout.flush()


def build_all(release: Release) -> list[str]:
    """Build each project, and its wheel again from its sdist; return what differs."""
    problems: list[str] = []
    for name, folder in PROJECTS.items():
        place = release.folder / name
        clean, from_sdist = build_twice(release.files, place, release.epoch, folder)
        release.built[name] = clean
        problems += differences(clean, from_sdist)
        for file in clean.files:
            say(f"build: {file.name}, {file.stat().st_size:,} bytes, sha256 {sha256(file)}")
    return problems


def check_metadata(release: Release, tag: str | None) -> list[str]:
    """Return the problems of versions and metadata."""
    versions = {name: release.layout(name).version for name in PROJECTS}
    problems = []
    if len(set(versions.values())) > 1:
        problems.append(f"the pyproject.toml have different versions: {versions}")
    if tag is not None:
        problems += problems_of_tag(
            tag, versions["stepbus"], release.files["CHANGELOG.md"].decode()
        )
    files = [file for built in release.built.values() for file in built.files]
    try:
        run(sys.executable, "-m", "twine", "--no-color", "check", "--strict", *files, cwd=ROOT)
    except Failed as exc:
        problems.append(str(exc))
    return problems


def problems_of_tag(tag: str, version: str, changelog: str) -> list[str]:
    """Return what does not fit a tag: the version, or the changelog that has no such section."""
    problems = []
    if tag != f"v{version}":
        problems.append(f"the tag {tag} is not v{version}, the version of pyproject.toml")
    if not re.search(rf"^## {re.escape(version)}\b", changelog, re.MULTILINE):
        problems.append(f"CHANGELOG.md has no section `## {version}`")
    return problems


def check_contents(release: Release) -> list[str]:
    """Return the problems of the files' contents."""
    problems: list[str] = []
    for name, built in release.built.items():
        layout = release.layout(name)
        problems += problems_of_wheel(built.wheel, layout)
        problems += problems_of_sdist(built.sdist, layout)
        say(f"contents: {name}: {len(layout.wheel())} files in the wheel")
    return problems


def wanted_hash(python: tuple[int, int], *, any_arithmetic: bool, engine: str) -> str | None:
    """Return the hash of two_link's messages that README.md shows; None: any will do."""
    line, pythons = HASHES[engine]
    if any_arithmetic or python not in pythons:
        return None
    match = re.search(line, (ROOT / "README.md").read_text(), re.MULTILINE)
    if match is None:
        raise Failed(f"README.md shows no hash of the messages with {engine}")
    return match[1]


def check_demo(release: Release, options: argparse.Namespace) -> list[str]:
    """Run the demo from the wheel, with the packages of this environment."""
    place = release.folder / "demo"
    place.mkdir()
    environment = borrowed(place, release.wheel)
    engine = "pybullet" if find_spec("pybullet") else "mujoco"
    wanted = wanted_hash(sys.version_info[:2], any_arithmetic=options.any_arithmetic, engine=engine)
    for line in try_demo(environment, release.layout("stepbus").version, wanted):
        say(f"demo: {line}")
    return []


def check_extras(release: Release, options: argparse.Namespace) -> list[str]:
    """Install each extra into an empty environment and use it; return those that fail."""
    problems = []
    names = options.extra or list(EXTRAS)
    for name in names:
        place = release.folder / f"extra-{name}"
        place.mkdir()
        timer = Timer()
        try:
            cache = release.folder / "pip"
            line = try_extra(name, place, release.wheel, cache)
            say(f"extras: {name}: {line}, {timer}")
        except Failed as exc:
            problems.append(f"extra {name}: {exc}")
            say(f"extras: {name}: FAILED, {timer}")
        shutil.rmtree(place)  # ten environments would need 5 GB
    return problems


def check_docs(release: Release) -> list[str]:
    """Run the tests of the pages' examples in a checkout, where `stepbus` is the wheel."""
    place = release.folder / "docs"
    place.mkdir()
    environment = borrowed(place, release.wheel)
    clone = check_out(release.files, place / "clone")
    program = "import stepbus, sys; sys.exit(not stepbus.__file__.startswith(sys.prefix))"
    environment.run("python", "-c", program, cwd=clone)
    words = ["-m", "pytest", "tests/docs/test_examples.py", "-k", "page", "-n", "2"]
    words += ["-m", "slow or not slow"]
    said = environment.run("python", *words, cwd=clone, patience_s=DOCS_PATIENCE_S)
    say(f"docs: {said.strip().splitlines()[-1].strip('= ')}")
    return []


def parts(options: argparse.Namespace) -> Iterator[tuple[str, Callable[[Release], list[str]]]]:
    """Yield the parts that are wanted; the build comes first, since all others need its files."""
    checks: dict[str, Callable[[Release], list[str]]] = {
        "build": build_all,
        "metadata": lambda release: check_metadata(release, options.tag),
        "contents": check_contents,
        "demo": lambda release: check_demo(release, options),
        "extras": lambda release: check_extras(release, options),
        "docs": check_docs,
    }
    for name, check in checks.items():
        if name == "build" or not options.only or name in options.only:
            yield name, check


def examine(options: argparse.Namespace, folder: Path) -> list[str]:
    """Make all checks that are wanted, and return what is wrong; stop where nothing is built."""
    commit, epoch = commit_of_head()
    release = Release(folder, commit, epoch, tracked_files(commit), {})
    say(f"commit {commit[:10]}, SOURCE_DATE_EPOCH {epoch}, in {folder}")
    problems: list[str] = []
    for name, check in parts(options):
        timer = Timer()
        try:
            wrong = check(release)
        except Failed as exc:
            wrong = [str(exc)]
        say(f"{name}: {'FAILED' if wrong else 'passed'} after {timer}")
        problems += [f"{name}: {line}" for line in wrong]
        if len(release.built) < len(PROJECTS):
            return problems
    if options.out is not None and not problems:
        keep(release, options.out)
    return problems


def keep(release: Release, out: Path) -> None:
    """Copy the files that were checked into a folder, with their hashes in SHA256SUMS."""
    out.mkdir(parents=True, exist_ok=True)
    lines = []
    for name, built in release.built.items():
        (out / name).mkdir(exist_ok=True)
        for file in built.files:
            shutil.copy(file, out / name / file.name)
            lines.append(f"{sha256(file)}  {name}/{file.name}\n")
    (out / "SHA256SUMS").write_text("".join(lines))
    say(f"{len(lines)} files and SHA256SUMS in {out}")


def options_of(words: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        prog="make release-check",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", action="append", choices=PARTS, help="this part; may be repeated")
    text = f"the same as --only for {', '.join(QUICK)}"
    parser.add_argument("--quick", dest="only", action="store_const", const=QUICK, help=text)
    parser.add_argument("--extra", action="append", choices=list(EXTRAS), help="of these extras")
    parser.add_argument("--tag", metavar="vX.Y.Z", help="check that the tag fits the version")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="keep the files that passed")
    text = "do not compare with the hash of README.md: another processor may give another one"
    parser.add_argument("--any-arithmetic", action="store_true", help=text)
    return parser.parse_args(words)


def main(words: Sequence[str]) -> int:
    """Make the checks and print the verdict; return 1 where something is wrong."""
    options, timer = options_of(words), Timer()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    with tempfile.TemporaryDirectory(prefix="sb-release-", ignore_cleanup_errors=True) as folder:
        try:
            problems = examine(options, Path(folder))
        except Failed as exc:
            problems = [str(exc)]
    for line in problems:
        say(line)
    which = ", ".join(options.only) if options.only else "all parts"
    verdict = f"FAILED, {len(problems)} problems" if problems else "passed"
    say(f"{verdict}: stepbus {version}, {which}, {timer}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
