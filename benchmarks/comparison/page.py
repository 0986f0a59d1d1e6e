"""The tables of docs/comparison.md, from results.json: `python -m benchmarks.comparison.page`.

The marks of each table are named `measured: …`.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from scripts.pages import filled

from stepbus_schemas.tables import table

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs/comparison.md"
NAMES = {
    "stepbus": "stepbus",
    "mosaik": "mosaik",
    "helics": "HELICS",
    "dora": "dora",
    "fmi": "libcosim with FMUs",
    "pybullet_gymnasium": "Gymnasium with PyBullet",
}
ONE_PROCESS = {"fmi", "pybullet_gymnasium"}
"""Tools in which the controller is a part of the process that runs everything."""
_CODE = {".py"}
_TIMESTAMP = re.compile(r"^(\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d(\.\d+)?( \|)? +")


def _yes(condition: bool) -> str:
    return "yes" if condition else "no"


def _count(number: int, noun: str, plural: str = "") -> str:
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def same(results: dict[str, Any]) -> str:
    """Return which tools repeat their result."""
    rows = []
    for name, tool in results["tools"].items():
        versions = ", ".join(
            f"{package} {version}" for package, version in tool["versions"].items()
        )
        recordings = set(tool["recordings"])
        recording = _yes(len(recordings) == 1) if recordings - {None} else "none"
        count = len(tool["traces"])
        repeats = f"{_yes(len(set(tool['traces'])) == 1)}, {_count(count, 'run')}"
        equal = _yes(set(tool["traces"]) == {results["loop"]})
        rows.append([NAMES[name], versions, repeats, equal, recording])
    header = ["", "Versions", "Same trace", "Equals a plain loop", "Same bytes of the recording"]
    return table(header, rows)


def _ending(strike: dict[str, Any], waited_s: float) -> str:
    if strike["ended"] == "by itself":
        return f"by itself, after {strike['seconds']} s"
    how = "ends at Ctrl-C" if strike["ended"] == "Ctrl-C" else "has to be killed"
    return f"not within {waited_s:.0f} s; {how}"


def _left(strike: dict[str, Any]) -> str:
    if not strike["left"]:
        return "none"
    later = len(strike["left_later"])
    programs = ", ".join(sorted({_program(command) for command in strike["left"]}))
    named = f"{len(strike['left'])} ({programs})"
    if later == len(strike["left"]):
        return f"{named}, still running after 60 s"
    return f"{named}; {later or 'none'} still running after 60 s"


def _program(command: str) -> str:
    words = [word.rpartition("/")[2] for word in command.split() if not word.startswith("-")]
    scripts = [word for word in words if word.endswith(".py")]
    return f"`{(scripts or words or ['?'])[0]}`"


def strikes(results: dict[str, Any], kind: str) -> str:
    """Return what becomes of each tool whose controller is killed, or sleeps."""
    rows = []
    for name, tool in results["tools"].items():
        row = [NAMES[name], *_struck(tool[kind], results["waited_s"])]
        if kind == "kill" and name in ONE_PROCESS:
            row[1] = "at once: it is the process that was killed"
        rows.append(row)
        if kind == "sleep" and "guarded" in tool:
            title = f"{NAMES[name]}, {tool['guarded']['guard']}"
            rows.append([title, *_struck(tool["guarded"], results["waited_s"])])
    header = ["", "Ends", "Exit code", "Recording has", "Processes left behind"]
    return table(header, rows)


def _struck(strike: dict[str, Any], waited_s: float) -> list[str]:
    steps = strike["recorded_steps"]
    recorded = "nothing" if steps is None else _count(steps, "step")
    exit_code = str(strike["exit_code"]).replace("-", "−")
    return [_ending(strike, waited_s), exit_code, recorded, _left(strike)]


def says(results: dict[str, Any], kind: str) -> str:
    """Return the line with which each tool names the failure, before anybody ends it."""
    rows = []
    for name, tool in results["tools"].items():
        rows.append([NAMES[name], _said(tool[kind])])
        if kind == "sleep" and "guarded" in tool:
            rows.append([f"{NAMES[name]}, {tool['guarded']['guard']}", _said(tool["guarded"])])
    return table(["", "Says"], rows)


def _said(strike: dict[str, Any]) -> str:
    lines = [_TIMESTAMP.sub("", line) for line in strike["says"]]
    naming = [line for line in lines if "controller" in line.lower()]
    chosen = (naming or lines or [""])[-1].strip().replace("|", "/").replace("`", "'")
    return f"`{chosen}`" if chosen else "nothing"


def lines(results: dict[str, Any]) -> str:
    """Return how much a user writes."""
    rows = []
    for name, tool in results["tools"].items():
        records = set(tool["record_files"])
        run = {file: n for file, n in tool["lines"].items() if file not in records}
        code = sum(n for file, n in run.items() if Path(file).suffix in _CODE)
        config = sum(n for file, n in run.items() if Path(file).suffix not in _CODE)
        record = sum(n for file, n in tool["lines"].items() if file in records)
        rows.append([NAMES[name], str(code), str(config), str(record), str(code + config + record)])
    header = ["", "Python", "Configuration", "For recording", "Total"]
    return table(header, rows)


def conditions(results: dict[str, Any]) -> str:
    """Return where and when it was measured."""
    return (
        f"Measured while other jobs ran (load {results['load']}) on {results['date']}: "
        f"{results['machine']}.\n"
    )


def tables(results: dict[str, Any]) -> dict[str, str]:
    """Return the parts of the page, by the names of their marks."""
    parts = {
        "conditions": conditions(results),
        "same": same(results),
        "kill": strikes(results, "kill"),
        "kill says": says(results, "kill"),
        "sleep": strikes(results, "sleep"),
        "sleep says": says(results, "sleep"),
        "lines": lines(results),
    }
    return {f"measured: {name}": text for name, text in parts.items()}


def read_results() -> dict[str, Any]:
    """Return what was measured, with the tools in the order of the page."""
    results: dict[str, Any] = json.loads((HERE / "results.json").read_text(encoding="utf-8"))
    tools = results["tools"]
    return results | {"tools": {name: tools[name] for name in NAMES if name in tools}}


def main() -> None:
    """Write the tables into the page."""
    page = filled(PAGE.read_text(encoding="utf-8"), tables(read_results()))
    PAGE.write_text(page, encoding="utf-8")
    sys.stdout.write(f"{PAGE}\n")


if __name__ == "__main__":
    main()
