"""Replay recordings, as the GitHub Action `action.yml` does, and summarise what differs.

Needs the command `stepbus` on the PATH; has no other dependency. Options come from the environment,
as the action sets them:

RECORDINGS    recordings or folders of runs, one path or pattern a line
PARTICIPANTS  names, separated by spaces; empty: all participants of each recording
TOLERANCE     YAML file of tolerances; empty: equal to the byte
SOURCE        folder or file of the scenario; empty: the current folder
TRUST         `true` also starts programs that are not those of your scenario
TIMEOUT       limit for one replay [s]; empty: 600
OUT           folder of reports and new recordings; must not exist, or be empty

Appends Markdown to $GITHUB_STEP_SUMMARY and `equal=true` or `equal=false` to $GITHUB_OUTPUT, where
these are set. Exit code: 0 equal, 10 different, 1 a replay failed or a
file cannot be written, 2 wrong options.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path

DIFFERENT = 10
NAME = re.compile("[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
"""Of a participant, as in a scenario: it becomes the name of a folder."""
_LINE = "%\r\n"
"""What a workflow command cannot have as it is."""


class WrongOptionError(Exception):
    """An option of the environment cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to replay, and how. words: of `stepbus replay`."""

    recordings: list[str]
    participants: list[str]
    words: list[str]
    timeout: float
    out: Path


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The result of one participant of one recording.

    code: of `stepbus replay`; said: what it printed; files: names of report and new recording,
    where it differs.
    """

    recording: str
    participant: str
    code: int
    said: str
    files: Sequence[str] = ()

    @property
    def verdict(self) -> str:
        """The result in one word."""
        return {0: "equal", DIFFERENT: "different"}.get(self.code, "failed")

    @property
    def reason(self) -> str:
        """The first divergence, or why the replay failed, in one line."""
        divergence = re.search(r"^first divergence: (.*)", self.said, re.MULTILINE)
        lines = [divergence[1]] if divergence else self.said.splitlines()
        return lines[0] if self.code and lines else ""


def options_from(env: Mapping[str, str]) -> Options:
    """Read the options of the environment; raise `WrongOptionError` where one cannot be used."""
    patterns = [line.strip() for line in env.get("RECORDINGS", "").splitlines() if line.strip()]
    if not patterns:
        raise WrongOptionError("recordings: name a recording or a pattern, e.g. tests/logs/*.mcap")
    recordings = [path for pattern in patterns for path in matches(pattern)]
    if not env.get("OUT"):
        raise WrongOptionError("OUT: name the folder of reports")
    out = Path(env["OUT"])
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise WrongOptionError(f"OUT: {out} is not an empty folder")
    trust = env.get("TRUST") or "false"
    if trust not in ("true", "false"):
        raise WrongOptionError(f"trust: {trust!r} is neither true nor false")
    try:
        timeout = float(env.get("TIMEOUT") or 600)
    except ValueError:
        timeout = -1.0
    if not 0 < timeout < float("inf"):
        raise WrongOptionError(f"timeout: {env['TIMEOUT']!r} is not a number of seconds above 0")
    participants = env.get("PARTICIPANTS", "").split()
    if wrong := [name for name in participants if not NAME.fullmatch(name)]:
        raise WrongOptionError(f"participants: {wrong[0]!r} is no name of a participant")
    words = ["--trust"] if trust == "true" else []
    for option in ("tolerance", "source"):
        words += [f"--{option}", env[option.upper()]] if env.get(option.upper()) else []
    return Options(
        recordings=list(dict.fromkeys(recordings)),
        participants=participants,
        words=words,
        timeout=timeout,
        out=out,
    )


def matches(pattern: str) -> list[str]:
    """Return the paths of a pattern, sorted; a pattern without one is a mistake, not a pass."""
    paths = sorted(glob(pattern, recursive=True))  # noqa: PTH207 - absolute patterns too
    if not paths:
        raise WrongOptionError(f"recordings: no file matches {pattern!r} in {Path.cwd()}")
    return paths


def stepbus(*arguments: str, timeout: float) -> tuple[int, str]:
    """Run a stepbus command; return its exit code, and its output, or its errors."""
    try:
        done = subprocess.run(
            ["stepbus", *arguments],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=timeout,
            check=False,
        )
    except FileNotFoundError:
        raise WrongOptionError(
            "stepbus is not installed: set the input `stepbus`, or install it in an earlier step"
        ) from None
    except subprocess.TimeoutExpired:
        return 1, f"no result after {timeout:g} s: stepbus {' '.join(arguments)}"
    said = done.stdout.strip() or done.stderr.strip()
    return done.returncode, said or f"stepbus {arguments[0]} ended with exit code {done.returncode}"


def replays(options: Options) -> Iterator[Replay]:
    """Replay each participant of each recording, in order."""
    for number, recording in enumerate(options.recordings, 1):
        names = options.participants
        if not names:
            code, said = stepbus("info", recording, "--json", timeout=options.timeout)
            if code:
                yield Replay(recording=recording, participant="", code=code, said=said)
                continue
            # `stepbus info` refuses a recording with a name that is a path.
            names = list(json.loads(said)["programs"])
        for name in names:
            folder = options.out / f"{number}-{Path(recording).stem}-{name}"
            yield replay(recording, name, folder, options)


def replay(recording: str, participant: str, folder: Path, options: Options) -> Replay:
    """Replay one participant; keep a report and the new recording where an output differs."""
    folder.mkdir(parents=True, exist_ok=True)
    new, limit = folder / "new.mcap", options.timeout
    words = ["replay", recording, "--participant", participant, "--update", str(new)]
    code, said = stepbus(*words, *options.words, timeout=limit)
    if code == DIFFERENT:
        page = str(folder / "report.html")
        failed, problem = stepbus("report", recording, str(new), "--out", page, timeout=limit)
        if failed:
            log(f"no report: {problem}")
    else:
        new.unlink(missing_ok=True)
    files = tuple(sorted(f"{folder.name}/{one.name}" for one in folder.iterdir()))
    if not files:
        folder.rmdir()
    return Replay(recording=recording, participant=participant, code=code, said=said, files=files)


def summary(results: Sequence[Replay]) -> str:
    """Return the job summary: a table, then what stepbus says of each difference. Markdown."""
    wrong = [one for one in results if one.code]
    verdict = f"{len(wrong)} of {len(results)} replays are not equal" if wrong else "all are equal"
    lines = [f"## stepbus replay: {verdict}", ""]
    lines += ["| Recording | Participant | Result | First divergence |", "|---|---|---|---|"]
    for one in results:
        mark = "**" if one.code else ""
        cells = (code(one.recording), plain(one.participant), f"{mark}{one.verdict}{mark}")
        lines.append(f"| {' | '.join(cells)} | {plain(one.reason)} |")
    for one in wrong:
        title = plain(f"{one.recording} {one.participant}".strip())
        lines += ["", f"### {title}", ""]
        # No text can end a block that is indented.
        lines += [f"    {visible(line)}" for line in one.said.splitlines()]
        if one.files:
            lines += ["", "In the artifact: " + ", ".join(map(code, one.files))]
    return "\n".join(lines) + "\n"


def plain(text: str) -> str:
    """Return Markdown that shows a text as it is, in one line."""
    return re.sub(r"([\\`*_~\[\]<>|&])", r"\\\1", visible(text))


def code(text: str) -> str:
    """Return Markdown that shows a text as code; plain where it has signs that would end that."""
    return plain(text) if "`" in text or "|" in text else f"`{visible(text)}`"


def visible(text: str) -> str:
    """Return a text in one line; no character of it controls a terminal."""
    return "".join(sign if sign.isprintable() else f"\\x{ord(sign):02x}" for sign in text)


def say(text: str) -> None:
    """Print to the job's log."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def log(text: str) -> None:
    """Print one line to the job's log that is no workflow command, whatever it has."""
    say(visible(text).replace("::", ": :").replace("##[", "## ["))


def append(variable: str, text: str) -> None:
    """Append to a file that GitHub names in the environment, if it does."""
    path = os.environ.get(variable)
    if path:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(text)


def error_command(text: str, **properties: str) -> str:
    """Return the workflow command that reports an error, in a file of a pull request."""
    given = {**properties, "title": "stepbus replay"}
    row = ",".join(f"{key}={percent(value, _LINE + ':,')}" for key, value in given.items())
    return f"::error {row}::{percent(text, _LINE)}"


def percent(text: str, signs: str) -> str:
    """Return a text with some of its signs as GitHub encodes them in workflow commands."""
    return "".join(f"%{ord(sign):02X}" if sign in signs else sign for sign in text)


def replay_all() -> int:
    """Replay everything; write the summary and the output `equal`; return the exit code."""
    results = []
    for one in replays(options_from(os.environ)):
        results.append(one)
        if one.code:
            who = one.participant or "recording"
            say(error_command(f"{who}: {one.reason}", file=one.recording))
        else:
            log(f"{one.recording} {one.participant}: {one.verdict}")
    codes = {one.code for one in results}
    append("GITHUB_STEP_SUMMARY", summary(results))
    append("GITHUB_OUTPUT", f"equal={'true' if codes <= {0} else 'false'}\n")
    if not os.environ.get("GITHUB_STEP_SUMMARY"):
        say(summary(results))
    return 0 if codes <= {0} else DIFFERENT if codes <= {0, DIFFERENT} else 1


def main() -> int:
    """Replay everything; print one error for what cannot be used or written."""
    # `subprocess.run` ends its program when an exception passes.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        return replay_all()
    except WrongOptionError as error:
        with contextlib.suppress(OSError):
            say(error_command(str(error)))
            append("GITHUB_STEP_SUMMARY", f"## stepbus replay\n\n{code(str(error))}\n")
        return 2
    except OSError as error:
        place = error.filename or "the job's log or summary"
        with contextlib.suppress(OSError):
            sys.stderr.write(f"stepbus replay: cannot write {place}: {error.strerror}\n")
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
