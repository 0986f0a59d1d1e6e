"""`make comparison`: the same small task in every tool, struck from outside, into results.json.

`python -m benchmarks.comparison.run [--only NAME]… [--runs N] [--out FOLDER] [--results FILE]`.
Each tool of tools.toml is installed into an environment of its own, FOLDER/environments/NAME; one
that does not install is left out and named. The results of a tool that is not run again are kept.
Two tools must not run at once: HELICS has one port for all.

Every process that a tool starts inherits a variable with a value of its own (`MARK`), by which it
is found whatever session or parent it has.
"""

import argparse
import ast
import datetime as dt
import hashlib
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
from benchmarks.suite.clock import machine

HERE = Path(__file__).parent
CHECKOUT = HERE.parents[1]
TOOLS: dict[str, dict[str, Any]] = tomllib.loads((HERE / "tools.toml").read_text())
MARK = "COMPARISON_MARK"
STALL_AT = 200
START_S, STALLED_S, GRACE_S, CLEAN_S = 120.0, 60.0, 20.0, 60.0
"""Time for a start; for a tool to end after the strike; after Ctrl-C; for what it left behind."""
_FAILURE = re.compile(
    r"error|exception|interrupt|kill|signal|failed|deadline|exited|lost|closed|done", re.IGNORECASE
)
_SHARED = HERE / "shared"
_VERSIONS = "import sys, importlib.metadata as m; print(*(m.version(x) for x in sys.argv[1:]))"


def alive(mark: str) -> list[psutil.Process]:
    """Return the processes with this mark; zombies are none."""
    found = psutil.process_iter(["environ"])
    return [p for p in found if (p.info["environ"] or {}).get(MARK) == mark]


def end_all(mark: str) -> None:
    """Kill every process with this mark."""

    def none_is_left() -> bool:
        for process in (left := alive(mark)):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        return not left

    _until(none_is_left, GRACE_S)


def _until(condition: Callable[[], Any], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def count_lines(path: Path) -> int:
    """Return the lines that a user writes: no blank line, no comment, no docstring."""
    lines = path.read_text().splitlines()
    for node in ast.walk(ast.parse(path.read_text())) if path.suffix == ".py" else ():
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            for number in range(node.lineno - 1, node.end_lineno or node.lineno):
                lines[number] = ""
    return sum(1 for line in lines if line.strip() and line.strip()[0] != "#")


def _traces(folder: Path) -> Path:
    """Return where the arm of a run writes: not in the folder of the tool, which may record it."""
    return folder.with_name(f"{folder.name}-trace")


class Workshop:
    """Runs one tool in fresh folders. out: holds the environments too."""

    def __init__(self, name: str, out: Path) -> None:
        self.name, self.tool = name, TOOLS[name]
        own = out / "environments" / name
        self.programs = own / "bin" if self.tool["packages"] else Path(sys.executable).parent
        self.out = out / "runs" / name
        shutil.rmtree(self.out, ignore_errors=True)

    def install(self) -> bool:
        """Make the environment, unless it is there; return whether it has all packages."""
        done = self.programs.parent / "complete"
        if not self.tool["packages"] or done.exists():
            return True
        subprocess.run([sys.executable, "-m", "venv", "--clear", done.parent], check=True)
        python = str(self.programs / "python")
        pip = [python, "-m", "pip", "install", "-q", "--only-binary", ":all:"]
        if subprocess.run([*pip, *self.tool["packages"]], check=False, timeout=600).returncode:
            return False
        done.touch()
        return True

    def folder(self, name: str) -> Path:
        """Return a folder with the files of the tool, in which a run called `name` happens."""
        folder = self.out / name
        shutil.copytree(HERE / self.name, folder, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(_SHARED / "arm.py", folder)
        _traces(folder).mkdir()
        for command in self.tool.get("prepare", ()):
            result = self.do(command, folder, "prepare")
            if result["exit_code"] != 0:
                raise RuntimeError(f"{self.name}: {command} failed: {result}")
        return folder

    def start(
        self, command: Sequence[str], folder: Path, log: Path, **more: str
    ) -> tuple[subprocess.Popen[bytes], str]:
        """Start a command in a session of its own; return it and its mark."""
        mark = uuid.uuid4().hex
        environment = {
            **os.environ,
            "PATH": f"{self.programs}{os.pathsep}{os.environ['PATH']}",
            "VIRTUAL_ENV": str(self.programs.parent),  # dora looks for it
            "PYTHONPATH": str(_SHARED),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONUNBUFFERED": "1",
            "COMPARISON_OUT": str(_traces(folder)),
            MARK: mark,
            **more,
        }
        with log.open("ab") as file:
            streams: Any = {"stdin": subprocess.DEVNULL, "stdout": file, "stderr": file}
            process = subprocess.Popen(
                command, cwd=folder, env=environment, start_new_session=True, **streams
            )
        return process, mark

    def do(self, command: Sequence[str], folder: Path, log: str) -> dict[str, Any]:
        """Run a command to its end; return its exit code (None: it had to be killed) and time."""
        began, code = time.monotonic(), None
        process, mark = self.start(command, folder, folder.with_suffix(f".{log}.log"))
        with process:
            with suppress(subprocess.TimeoutExpired):
                code = process.wait(START_S)
            seconds = time.monotonic() - began
            end_all(mark)
        return {"exit_code": code, "seconds": round(seconds, 1)}

    def strike(self, command: Sequence[str], name: str, *, kill: bool = False) -> dict[str, Any]:
        """Run the task until the controller stops at its step; kill it there, or let it sleep.

        Returns whether the tool ended (`ended`: by itself, Ctrl-C, or killed), its exit code, the
        seconds from the strike to its end, the processes that it left behind (`left`: at its end;
        `left_later`: after `CLEAN_S`), and what it said before anybody ended it.
        """
        folder = self.folder(name)
        log, trace = folder.with_suffix(".run.log"), _traces(folder) / "trace.txt"
        stalled = _traces(folder) / "stalled"
        process, mark = self.start(command, folder, log, COMPARISON_STALL=str(STALL_AT))
        with process:
            try:
                _until(lambda: stalled.exists() or process.poll() is not None, START_S)
                if not stalled.exists():
                    raise RuntimeError(f"{command}: the controller did not reach its step")
                began = time.monotonic()
                if kill:
                    os.kill(int(stalled.read_text()), signal.SIGKILL)
                result = _end(process, log) | {"seconds": round(time.monotonic() - began, 1)}
                result["left"] = _commands(mark, folder)
                _until(lambda: not alive(mark), CLEAN_S)
                result["left_later"] = _commands(mark, folder)
            finally:
                end_all(mark)
        return result | {
            "plant_steps": trace.read_text().count("\n") if trace.exists() else 0,
            "recorded_steps": self.recorded(folder),
            "says": _said(result.pop("log"), folder),
        }

    def recorded(self, folder: Path) -> int | None:
        """Return how many steps the recording has; None where there is none that can be read."""
        files = sorted(folder.glob(self.tool.get("recording", "no-recording")))
        if not files or "steps" not in self.tool:
            return None
        with suppress(OSError, ValueError, KeyError):
            match self.tool["steps"]:
                case {"topic": topic}:
                    import stepbus  # noqa: PLC0415  of this tool only

                    with stepbus.Recording(files[0]) as recording:
                        return sum(1 for _ in recording[topic].maps())
                case {"word": word}:
                    return files[0].read_text(errors="replace").count(word)
                case {"less": less}:
                    return max(files[0].read_text(errors="replace").count("\n") - int(less), 0)
        return None


def _end(process: subprocess.Popen[bytes], log: Path) -> dict[str, Any]:
    said = b""
    for ended, seconds in (("by itself", STALLED_S), ("Ctrl-C", GRACE_S), ("killed", GRACE_S)):
        with suppress(subprocess.TimeoutExpired):
            code = process.wait(seconds)
            text = (said or log.read_bytes()).decode(errors="replace")
            return {"ended": ended, "exit_code": code, "log": text}
        said = said or log.read_bytes()
        # A terminal sends Ctrl-C to the whole process group.
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT if ended == "by itself" else signal.SIGKILL)
    raise RuntimeError(f"process {process.pid} cannot be killed")


def _commands(mark: str, folder: Path) -> list[str]:
    """Return the command lines of the processes with a mark, without folders of this machine."""
    lines = []
    for process in alive(mark):
        with suppress(psutil.NoSuchProcess):
            text = " ".join(process.cmdline()).replace(str(folder), ".")
            lines.append(" ".join(re.sub(r"/\S*/", "", text).split())[:80])
    return sorted(lines)


def _said(log: str, folder: Path) -> list[str]:
    """Return the lines with which a tool reports a failure, without colours and folders."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", log).replace(str(folder), ".")
    text = re.sub(r"(?<![\w.])/\S*/(?=[\w.-]+)", "", text)
    lines = [line.rstrip()[:200] for line in text.splitlines() if line.strip()]
    return [line for line in lines if _FAILURE.search(line) and not line.startswith(" ")][-8:]


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def measure(workshop: Workshop, runs: int) -> dict[str, Any]:
    """Return all that is measured of one tool."""
    tool = workshop.tool
    command = [str(workshop.programs / "python"), "-c", _VERSIONS, *tool["shows"]]
    shown = subprocess.run(command, check=True, capture_output=True, text=True)
    folders = [workshop.folder(f"whole{number}") for number in range(runs)]
    whole = [workshop.do(tool["command"], folder, "run") for folder in folders]
    for folder, run in zip(folders, whole, strict=True):
        if run["exit_code"] != 0 or not (_traces(folder) / "trace.txt").exists():
            log = folder.with_suffix(".run.log")
            raise RuntimeError(f"{workshop.name}: ended with {run['exit_code']}; see {log}")
    pattern, record = tool.get("recording", "no-recording"), tool.get("record", [])
    files = [next(iter(sorted(folder.glob(pattern))), None) for folder in folders]
    names = [*tool["code"], *record]
    result = {
        "versions": dict(zip(tool["shows"], shown.stdout.split(), strict=True)),
        "lines": {name: count_lines(HERE / workshop.name / name) for name in names},
        "record_files": record,
        "exit_codes": [run["exit_code"] for run in whole],
        "traces": [_sha256(_traces(folder) / "trace.txt") for folder in folders],
        "recordings": [_sha256(file) for file in files if file],
        "recorded_steps": workshop.recorded(folders[0]),
    }
    result["replay"] = [
        workshop.do(command, folders[0], "replay") | {"command": " ".join(command)[:80]}
        for command in tool.get("replay", ())
    ]
    result["kill"] = workshop.strike(tool["command"], "kill", kill=True)
    result["sleep"] = workshop.strike(tool["command"], "sleep")
    if "guarded" in tool:
        struck = workshop.strike(tool["guarded"], "guarded")
        result["guarded"] = struck | {"guard": tool["guard"]}
    return result


def plain_loop(out: Path) -> str:
    """Return the hash of the trace of a loop without any tool."""
    folder = out / "runs/loop"
    folder.mkdir(parents=True, exist_ok=True)
    environment: Mapping[str, str] = {**os.environ, "COMPARISON_OUT": str(folder)}
    subprocess.run([sys.executable, str(_SHARED / "arm.py")], check=True, env=environment)
    return _sha256(folder / "trace.txt")


def main() -> None:
    """Measure, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", choices=TOOLS, help="these tools only")
    parser.add_argument("--runs", type=int, default=5, help="undisturbed runs of each tool")
    parser.add_argument("--out", type=Path, default=CHECKOUT / "build/comparison")
    parser.add_argument("--results", type=Path, default=HERE / "results.json")
    args = parser.parse_args()
    out = args.out.resolve()
    old = json.loads(args.results.read_text()) if args.results.exists() else {"tools": {}}
    results = {
        "date": dt.datetime.now(tz=dt.UTC).date().isoformat(),
        "machine": machine(),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),
        "stall_at": STALL_AT,
        "waited_s": STALLED_S,
        "loop": plain_loop(out),
        "tools": old["tools"],
    }
    for name in args.only or TOOLS:
        workshop = Workshop(name, out)
        if not workshop.install():
            sys.stderr.write(f"{name}: does not install here; left out\n")
            continue
        try:
            results["tools"][name] = measured = measure(workshop, args.runs)
        except RuntimeError as exc:
            raise SystemExit(f"comparison: {exc}") from exc
        kinds = ("kill", "sleep", "guarded")
        ends = [measured[kind]["ended"] for kind in kinds if kind in measured]
        sys.stderr.write(f"{name}: {', '.join(ends)}\n")
        args.results.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
