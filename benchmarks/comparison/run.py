"""`make comparison`: the same small task in every tool, struck from outside, into results.json.

`python -m benchmarks.comparison.run [--only NAME]… [--runs N] [--out FOLDER] [--results FILE]`.
Each tool is installed into an environment of its own, FOLDER/environments/NAME, by name from the
package index; one that does not install is left out and named. The results of a tool that is not
run again are kept. Two tools must not run at once: HELICS has one port for all.
"""

import argparse
import datetime as dt
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import uuid
from pathlib import Path
from typing import Any

from benchmarks.comparison import processes
from benchmarks.comparison.lines import count_lines
from benchmarks.comparison.tools import CHECKOUT, HERE, TOOLS, Tool, interpreter
from benchmarks.suite import machine

STALL_AT = 200
_FAILURE = re.compile(
    r"error|exception|interrupt|kill|signal|failed|deadline|exited|lost|closed|done", re.IGNORECASE
)
_SHARED = HERE / "shared"
_VERSIONS = "import sys, importlib.metadata as m; print(*(m.version(x) for x in sys.argv[1:]))"


def install(tool: Tool, environments: Path) -> bool:
    """Make the environment of a tool, unless it is there; return whether it has all packages."""
    folder = environments / tool.name
    if not tool.packages or (folder / "complete").exists():
        return True
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)], check=True)
    pip = [str(folder / "bin/python"), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, "--only-binary", ":all:", *tool.packages], check=False, timeout=600
    )
    if done.returncode == 0:
        (folder / "complete").touch()
    return done.returncode == 0


def _traces(folder: Path) -> Path:
    """Return where the arm of a run writes: not in the folder of the tool, which may record it."""
    return folder.with_name(f"{folder.name}-trace")


class Workshop:
    """Runs one tool in fresh folders."""

    def __init__(self, tool: Tool, out: Path) -> None:
        self.tool = tool
        self.python = interpreter(tool, out / "environments")
        self.out = out / "runs" / tool.name
        shutil.rmtree(self.out, ignore_errors=True)

    def folder(self, name: str) -> Path:
        """Return a folder with the files of the tool, in which a run called `name` happens."""
        folder = self.out / name
        shutil.copytree(HERE / self.tool.name, folder, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(_SHARED / "arm.py", folder)
        _traces(folder).mkdir()
        for command in self.tool.prepare:
            result = self.do(command, folder, "prepare")
            if result["exit_code"] != 0:
                raise RuntimeError(f"{self.tool.name}: {command} failed: {result}")
        return folder

    def environment(self, folder: Path, **more: str) -> dict[str, str]:
        return {
            **os.environ,
            "PATH": f"{self.python.parent}{os.pathsep}{os.environ['PATH']}",
            "VIRTUAL_ENV": str(self.python.parents[1]),  # dora looks for it
            "PYTHONPATH": str(_SHARED),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONUNBUFFERED": "1",
            "COMPARISON_OUT": str(_traces(folder)),
            processes.MARK: uuid.uuid4().hex,
            **more,
        }

    def do(self, command: tuple[str, ...], folder: Path, log: str) -> dict[str, Any]:
        """Run a command of the tool to its end."""
        return processes.run(
            command, folder, self.environment(folder), folder.with_suffix(f".{log}.log")
        )

    def strike(self, command: tuple[str, ...], name: str, *, kill: bool = False) -> dict[str, Any]:
        """Run the task until the controller stops, and see what becomes of it."""
        folder = self.folder(name)
        environment = self.environment(folder, COMPARISON_STALL=str(STALL_AT))
        log = folder.with_suffix(".run.log")
        stalled, trace = _traces(folder) / "stalled", _traces(folder) / "trace.txt"
        started = processes.start(command, folder, environment, log)
        mark = environment[processes.MARK]
        result = processes.strike(started, stalled, mark, kill=kill, log=log)
        result["left"] = [_short(text, folder) for text in result["left"]]
        result["left_later"] = [_short(text, folder) for text in result["left_later"]]
        return result | {
            "plant_steps": trace.read_text().count("\n") if trace.exists() else 0,
            "recorded_steps": self.recorded(folder),
            "says": _said(result.pop("log"), folder),
        }

    def recorded(self, folder: Path) -> int | None:
        """Return how many steps the recording has; None where there is none that can be read."""
        files = sorted(folder.glob(self.tool.recording)) if self.tool.recording else []
        if not files or self.tool.steps is None:
            return None
        try:
            return self.tool.steps(files[0])
        except (OSError, ValueError, KeyError):
            return None


def _short(text: str, folder: Path) -> str:
    """Return a command line without the folders of this machine."""
    words = re.sub(r"/\S*/", "", text.replace(str(folder), ".")).split()
    return " ".join(words)[:80]


def _text(text: str, folder: Path) -> list[str]:
    """Return the lines of a text, without colours and folders of this machine."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text).replace(str(folder), ".")
    text = re.sub(r"(?<![\w.])/\S*/(?=[\w.-]+)", "", text)
    return [line.rstrip()[:200] for line in text.splitlines() if line.strip()]


def _said(log: str, folder: Path) -> list[str]:
    """Return the lines with which a tool reports a failure."""
    lines = _text(log, folder)
    return [line for line in lines if _FAILURE.search(line) and not line.startswith(" ")][-8:]


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def measure(tool: Tool, out: Path, runs: int) -> dict[str, Any]:
    """Return all that is measured of one tool."""
    workshop = Workshop(tool, out)
    python = str(workshop.python)
    shown = subprocess.run(
        [python, "-c", _VERSIONS, *tool.shows], check=True, capture_output=True, text=True
    )
    folders = [workshop.folder(f"whole{number}") for number in range(runs)]
    whole = [workshop.do(tool.command, folder, "run") for folder in folders]
    for folder, run in zip(folders, whole, strict=True):
        if run["exit_code"] != 0 or not (_traces(folder) / "trace.txt").exists():
            log = folder.with_suffix(".run.log")
            raise RuntimeError(f"{tool.name}: ended with {run['exit_code']}; see {log}")
    traces = [_sha256(_traces(folder) / "trace.txt") for folder in folders]
    files = [next(iter(sorted(f.glob(tool.recording))), None) for f in folders if tool.recording]
    result = {
        "versions": dict(zip(tool.shows, shown.stdout.split(), strict=True)),
        "lines": {name: count_lines(HERE / tool.name / name) for name in tool.code + tool.record},
        "record_files": list(tool.record),
        "exit_codes": [run["exit_code"] for run in whole],
        "traces": traces,
        "recordings": [_sha256(file) if file else None for file in files],
        "recorded_steps": workshop.recorded(folders[0]),
    }
    result["replay"] = [
        workshop.do(command, folders[0], "replay") | {"command": " ".join(command)[:80]}
        for command in tool.replay
    ]
    result["kill"] = workshop.strike(tool.command, "kill", kill=True)
    result["sleep"] = workshop.strike(tool.command, "sleep")
    if tool.guarded:
        result["guarded"] = workshop.strike(tool.guarded, "guarded") | {"guard": tool.guard}
    return result


def plain_loop(out: Path) -> str:
    """Return the hash of the trace of a loop without any tool."""
    folder = out / "runs/loop"
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "COMPARISON_OUT": str(folder)}
    subprocess.run([sys.executable, str(_SHARED / "arm.py")], check=True, env=environment)
    return _sha256(folder / "trace.txt")


def main() -> None:
    """Measure, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [tool.name for tool in TOOLS]
    parser.add_argument("--only", action="append", choices=names, help="these tools only")
    parser.add_argument("--runs", type=int, default=5, help="undisturbed runs of each tool")
    parser.add_argument("--out", type=Path, default=CHECKOUT / "build/comparison")
    parser.add_argument("--results", type=Path, default=HERE / "results.json")
    args = parser.parse_args()
    out = args.out.resolve()
    old = json.loads(args.results.read_text()) if args.results.exists() else {"tools": {}}
    results = {
        "date": dt.datetime.now(tz=dt.UTC).date().isoformat(),
        "machine": machine.name(),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),
        "stall_at": STALL_AT,
        "waited_s": processes.STALLED_S,
        "loop": plain_loop(out),
        "tools": old["tools"],
    }
    for tool in TOOLS:
        if args.only and tool.name not in args.only:
            continue
        if not install(tool, out / "environments"):
            sys.stderr.write(f"{tool.name}: does not install here; left out\n")
            continue
        try:
            results["tools"][tool.name] = measured = measure(tool, out, args.runs)
        except RuntimeError as exc:
            raise SystemExit(f"comparison: {exc}") from exc
        ends = [
            measured[kind]["ended"] for kind in ("kill", "sleep", "guarded") if kind in measured
        ]
        sys.stderr.write(f"{tool.name}: {', '.join(ends)}\n")
        args.results.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
