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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Any

DIFFERENT = 10
NAME = re.compile("[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
"""Of a participant, as in a scenario: it becomes the name of a folder."""
_LINE = "%\r\n"
"""What a workflow command cannot have as it is."""


class WrongOptionError(Exception):
    """An option of the environment cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to replay, and how."""

    recordings: list[Path]
    participants: list[str]
    tolerance: str
    source: str
    trust: bool
    timeout: float
    out: Path


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The result of one participant of one recording.

    `code`: exit code of `stepbus replay`; `result`: its JSON, empty where it failed; `problem`: its
    error message, where it failed; `files`: names of report and new recording, where it differs.
    """

    recording: Path
    participant: str
    code: int
    result: Mapping[str, Any]
    problem: str = ""
    files: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """The result in one word. Markdown."""
        return {0: "equal", DIFFERENT: "**different**"}.get(self.code, "**failed**")

    @property
    def divergence(self) -> str:
        """The first divergence in one line; the error message where the replay failed."""
        first = self.result.get("divergence")
        if not first:
            return self.problem.splitlines()[0] if self.problem else ""
        place = f"step {first['step']}: {first['topic']}"
        if first.get("field"):
            name, (field, _, rest) = first.get("name"), first["field"].partition("[")
            place += f": {field}[{name}]{rest.partition(']')[2]}" if name else f": {first['field']}"
        if first.get("type") != "value":
            return f"{place}: {first.get('type')}"
        return f"{place}: recording {first['first']}, replay {first['second']}"


def options_from(env: Mapping[str, str]) -> Options:
    """Read the options of the environment; raise `WrongOptionError` where one cannot be used."""
    patterns = [line.strip() for line in env.get("RECORDINGS", "").splitlines() if line.strip()]
    if not patterns:
        raise WrongOptionError("recordings: name a recording or a pattern, e.g. tests/logs/*.mcap")
    recordings = [Path(path) for pattern in patterns for path in matches(pattern)]
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
    return Options(
        recordings=list(dict.fromkeys(recordings)),
        participants=participants,
        tolerance=env.get("TOLERANCE", ""),
        source=env.get("SOURCE", ""),
        trust=trust == "true",
        timeout=timeout,
        out=out,
    )


def matches(pattern: str) -> list[str]:
    """Return the paths of a pattern, sorted; a pattern without one is a mistake, not a pass."""
    paths = sorted(glob(pattern, recursive=True))  # noqa: PTH207 - absolute patterns too
    if not paths:
        raise WrongOptionError(f"recordings: no file matches {pattern!r} in {Path.cwd()}")
    return paths


def stepbus(*arguments: str, timeout: float) -> tuple[int, str, str]:
    """Run a stepbus command; return its exit code, output and errors."""
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
        return 1, "", f"no result after {timeout:g} s: stepbus {' '.join(arguments)}"
    return done.returncode, done.stdout, done.stderr.strip()


def replays(options: Options) -> Iterator[Replay]:
    """Replay each participant of each recording, in order."""
    for number, recording in enumerate(options.recordings, 1):
        names = options.participants
        if not names:
            code, output, errors = stepbus(
                "info", str(recording), "--json", timeout=options.timeout
            )
            if code:
                yield Replay(
                    recording=recording, participant="", code=code, result={}, problem=errors
                )
                continue
            # `stepbus info` refuses a recording with a name that is a path.
            names = list(json.loads(output)["programs"])
        for name in names:
            yield replay(
                recording, name, options.out / f"{number}-{recording.stem}-{name}", options
            )


def replay(recording: Path, participant: str, folder: Path, options: Options) -> Replay:
    """Replay one participant; keep a report and the new recording where an output differs."""
    folder.mkdir(parents=True, exist_ok=True)
    new = folder / "new.mcap"
    command = ["replay", str(recording), "--participant", participant, "--json"]
    command += ["--update", str(new)]
    command += ["--tolerance", options.tolerance] if options.tolerance else []
    command += ["--source", options.source] if options.source else []
    command += ["--trust"] if options.trust else []
    code, output, errors = stepbus(*command, timeout=options.timeout)
    done = code in (0, DIFFERENT)
    if code == DIFFERENT:
        page = folder / "report.html"
        failed, _, problem = stepbus(
            "report", str(recording), str(new), "--out", str(page), timeout=options.timeout
        )
        if failed:
            log(f"no report: {problem}")
    else:
        new.unlink(missing_ok=True)
    files = tuple(sorted(f"{folder.name}/{one.name}" for one in folder.iterdir()))
    if not files:
        folder.rmdir()
    return Replay(
        recording=recording,
        participant=participant,
        code=code,
        result=json.loads(output) if done else {},
        problem="" if done else errors or output or f"stepbus replay ended with exit code {code}",
        files=files,
    )


def summary(results: list[Replay]) -> str:
    """Return the job summary: a table, then the details of each difference. Markdown."""
    wrong = [one for one in results if one.code]
    verdict = f"{len(wrong)} of {len(results)} replays are not equal" if wrong else "all are equal"
    lines = [f"## stepbus replay: {verdict}", ""]
    lines += [
        "| Recording | Participant | Result | Steps | First divergence |",
        "|---|---|---|---|---|",
    ]
    for one in results:
        cells = [
            code(str(one.recording)),
            plain(one.participant),
            one.verdict,
            str(one.result.get("steps", "")),
            plain(one.divergence),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    for one in wrong:
        lines += ["", *details(one)]
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


def details(one: Replay) -> list[str]:
    """Return the inputs and changed ports of one difference, or the error message."""
    title = " ".join(filter(None, (f"{one.recording}", one.participant)))
    head = [
        f"### {plain(title)}",
        "",
        plain(one.divergence) if one.result else "The replay failed.",
        "",
    ]
    lines = one.problem.splitlines()
    for change in one.result.get("changes", []):
        lines.append(f"changed since the recording: {change}")
    for port, value in one.result.get("inputs", {}).items():
        lines.append(
            f"input {port} ({value['topic']}@{value['step']}): {json.dumps(value['value'])}"
        )
    for port in one.result.get("ports", []):
        total = sum(port[key] for key in ("equal", "within", "different", "missing", "added"))
        lines.append(f"{port['topic']}: {total - port['equal'] - port['within']} of {total} differ")
    text = "\n".join(map(visible, lines))
    # Longer than any in the text: only this one ends the block.
    fence = "`" * max([3, *(1 + len(ticks) for ticks in re.findall("`+", text))])
    block = [f"{fence}text", text, fence]
    if one.files:
        block += ["", "In the artifact: " + ", ".join(map(code, one.files))]
    return head + block


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


def annotation(one: Replay) -> str:
    """Return the line by which GitHub marks a recording in the files of a pull request."""
    return error_command(
        f"{one.participant or 'recording'}: {one.divergence}", file=str(one.recording)
    )


def error_command(text: str, **properties: str) -> str:
    """Return the workflow command that reports an error."""
    given = {**properties, "title": "stepbus replay"}
    row = ",".join(f"{key}={percent(value, _LINE + ':,')}" for key, value in given.items())
    return f"::error {row}::{percent(text, _LINE)}"


def percent(text: str, signs: str) -> str:
    """Return a text with some of its signs as GitHub encodes them in workflow commands."""
    return "".join(f"%{ord(sign):02X}" if sign in signs else sign for sign in text)


def report_on(results: list[Replay]) -> int:
    """Write the summary and the output `equal`; return the exit code."""
    text = summary(results)
    append("GITHUB_STEP_SUMMARY", text)
    codes = {one.code for one in results}
    append("GITHUB_OUTPUT", f"equal={'true' if codes <= {0} else 'false'}\n")
    if not os.environ.get("GITHUB_STEP_SUMMARY"):
        say(text)
    return 0 if codes <= {0} else DIFFERENT if codes <= {0, DIFFERENT} else 1


def replay_all() -> int:
    """Replay everything; return the exit code."""
    results = []
    for one in replays(options_from(os.environ)):
        results.append(one)
        line = f"{one.recording} {one.participant}: {one.verdict.strip('*')}"
        if one.code:
            say(annotation(one))
        else:
            log(line)
    return report_on(results)


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
