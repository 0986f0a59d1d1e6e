"""Reference FMUs in stepbus, beside the results that ship with them; and branches of the runs.

`reference.py CHECKOUT [FOLDER …]`: a checkout of modelica/Reference-FMUs, and the folders with the FMUs
that you have built of it. Recordings are read by `mcap` and `msgpack`, without stepbus. It ends
with 1 where a result differs by more than the cross-check allows, or a branch by a byte.
"""

import argparse
import csv
import json
import math
import random
import shutil
import struct
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import msgpack
import numpy as np
from fmpy.util import validate_result
from mcap.reader import make_reader
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import stepbus

_BRANCHES = 20
_FEWEST_STEPS = 100
_ALLOWED = 0.1
"""Share of the samples outside the band above which a result fails the cross-check."""
_STEPS = 1_000_000
_ALLOWED_GROWTH = 4 << 20  # bytes
Table = dict[str, list[Any]]
"""Column → value of each row; the first column is `time` [s]."""


# --- what is expected -----------------------------------------------------------------------


def read_table(file: Path) -> Table:
    """Read a CSV file; a column of vectors becomes one for each element, `y[1]` and so on."""
    with file.open(newline="") as lines:
        head, *rows = csv.reader(lines)
    table: Table = {}
    for name, column in zip(head, zip(*rows, strict=True), strict=True):
        values = [value(name, text) for text in column]
        if isinstance(values[0], list):
            table |= {f"{name}[{i}]": list(v) for i, v in enumerate(zip(*values, strict=True), 1)}
        else:
            table[name] = values
    return table


def value(name: str, text: str) -> Any:
    """Return the value that a text of a column stands for."""
    if name.startswith("String"):
        return text
    if name.startswith("Binary"):
        return bytes.fromhex(text)
    if name.startswith(("Int", "UInt", "Enum")):
        return int(text)
    if text in ("true", "false"):
        return text == "true"
    numbers = [float(part) for part in text.split(" ")]
    return numbers if len(numbers) > 1 else numbers[0]


def roberts(times: NDArray[np.float64]) -> Table:
    """Solve Robertson's problem: the file that ships with its FMU is that of BouncingBall."""

    def slope(_: float, y: Sequence[float]) -> list[float]:
        first = -0.04 * y[0] + 1e4 * y[1] * (1 - y[0] - y[1])
        return [first, -first - 3e7 * y[1] * y[1]]

    span = times[0], times[-1]
    done = solve_ivp(slope, span, [1, 0], "Radau", times, rtol=1e-10, atol=1e-14)
    y1, y2 = done.y
    return {"time": list(times), "y1": list(y1), "y2": list(y2), "y3": list(1 - y1 - y2)}


def fed(k: int, columns: Mapping[str, Sequence[Any]], h: float) -> dict[str, Any]:
    """Return the value of each input of Feedthrough at a step: integers as in its CSV file."""
    row = max(i for i, t in enumerate(columns["time"]) if t <= k * h + 1e-9)
    whole = {name: column[row] for name, column in columns.items() if name != "time"}
    return {
        **{f"Float{bits}_{kind}_input": f for bits in (32, 64) for kind, f in
           (("continuous", k / 8), ("discrete", float(k // 3)))},
        **whole,
        "Enumeration_input": 1 + k % 2,
        "Boolean_input": k % 4 > 1,
        "String_input": f"text {k // 5} ä",
        "Binary_input": bytes(range(k % 3)),
    }  # fmt: skip


class Feed(stepbus.Participant):
    """Publishes the inputs of Feedthrough."""

    def __init__(self, config: stepbus.Config) -> None:
        super().__init__(config)
        self._columns = read_table(config.folder / config.params["file"])
        self._h = config.step_ns / 1e9
        kinds = {"Scalars/1": float, "Integers/1": int, "Booleans/1": bool, "Texts/1": str,
                 "Binaries/1": bytes}  # fmt: skip
        self._kinds = {port: kinds[item.type] for port, item in config.outputs.items()}

    def _of(self, port: str, step: int) -> dict[str, Any]:
        values = fed(step, self._columns, self._h)
        return {name: v for name, v in values.items() if type(v) is self._kinds[port]}

    def describe(self) -> dict[str, stepbus.Description]:
        """Return the names of the inputs."""
        return {port: stepbus.Description(names=list(self._of(port, 0))) for port in self._kinds}

    def output(self, step: stepbus.Step) -> dict[str, Any]:
        """Return the values of a step."""
        types = {port: self.config.types[self.config.outputs[port].type] for port in self._kinds}
        return {
            port: cls(values=list(self._of(port, step.index).values()))
            for port, cls in types.items()
        }


# --- what is run ----------------------------------------------------------------------------


def recorded(folder: Path, name: str, start: float = 0.0) -> Table:
    """Read what a participant of a run has published."""
    table: Table = {"time": []}
    with (folder / "run.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if not channel.topic.startswith(f"{name}/"):
                continue
            time = start + message.log_time / 1e9
            if not table["time"] or table["time"][-1] < time:
                table["time"].append(time)
            values = msgpack.unpackb(message.data)["values"]
            names = json.loads(channel.metadata["description"])["names"]
            for variable, item in zip(names, values, strict=True):
                table.setdefault(variable, []).append(item)
    return table


def scenario(fmu: Path, h: float, steps: int, feed: Path | None) -> dict[str, Any]:
    """Return the scenario of an FMU, with all its inputs from a file where there is one."""
    participants: dict[str, Any] = {"fmu": {"participant": "fmu.fmu"}}
    if feed is not None:
        ports = {"reals": "Scalars/1", "whole": "Integers/1", "truth": "Booleans/1",
                 "texts": "Texts/1", "bytes": "Binaries/1"}  # fmt: skip
        if fmpy.read_model_description(fmu).fmiVersion[0] == "2":
            del ports["bytes"]
        participants["fmu"]["inputs"] = {
            name: {"from": f"feed.{name}", "type": type_} for name, type_ in ports.items()
        }
        participants["feed"] = {
            "participant": "feed.py:Feed",
            "publishes": "first",
            "outputs": ports,
            "params": {"file": feed.name},
        }
    if fmu.stem == "Roberts":  # its description claims an event mode that it refuses
        participants["fmu"]["params"] = {"event_mode": False}
    step_ns = round(h * 1e9)
    return {
        "name": fmu.stem,
        "step": f"{step_ns}ns",
        "duration": f"{steps * step_ns}ns",
        "checkpoint": f"{step_ns * max(1, steps // 50)}ns",
        "participants": participants,
    }


def run(
    fmu: Path, h: float, steps: int, feed: Path | None, work: Path, *, in_process: bool = False
) -> stepbus.Result:
    """Run an FMU into the folder `run`, with checkpoints unless in this process."""
    if feed is not None:
        shutil.copy(__file__, work / "feed.py")
        shutil.copy(feed, work)
    shutil.copy(fmu, work / "fmu.fmu")
    data = scenario(fmu, h, steps, feed)
    if in_process:
        del data["checkpoint"]
    return stepbus.run(stepbus.load(data, folder=work), out=work / "run", in_process=in_process)


def compare(result: Table, reference: Table) -> tuple[str, float, float]:
    """Return what differs, the share of outliers by FMPy's rule, and the largest difference."""
    n = len(reference["time"])
    if not np.allclose(result["time"][:n], reference["time"], rtol=0, atol=1e-9):
        return "other times", 1.0, math.inf
    shared = [name for name in reference if name in result and name != "time"]
    if not shared:
        return "no variable is in both", 1.0, math.inf
    reals = [name for name in shared if isinstance(reference[name][0], float)]
    largest = 0.0
    for name in shared:
        if name in reals:
            found, given = (np.array(t[name][:n], float) for t in (result, reference))
            largest = max(largest, float(np.max(np.abs(found - given))))
        elif result[name][:n] != reference[name]:
            return f"{name} differs", 1.0, math.inf
    if not math.isfinite(largest):  # FMPy takes what is not a number for no outlier
        return "not finite", 1.0, largest
    share = validate_result(*(structured(t, reals, n) for t in (result, reference)))
    return ("" if share <= _ALLOWED else "outside the band"), float(share), largest


def structured(table: Table, names: Sequence[str], n: int) -> NDArray[Any]:
    """Return columns of a table as FMPy has them."""
    columns = ["time", *names]
    rows = list(zip(*(table[name][:n] for name in columns), strict=True))
    return np.array(rows, dtype=[(name, np.float64) for name in columns])


def branches(folder: Path, steps: int) -> str:
    """Branch a run at random steps; return how many went on to the byte, or what is wrong."""
    chosen = random.Random(0).sample(range(2, steps), _BRANCHES)
    content = (folder / "run.mcap").read_bytes()
    for number, at in enumerate(sorted(chosen)):
        out = folder.with_name(f"{folder.name}-{number}")
        done = stepbus.branch(folder, out, at=at, in_process=True)
        if done.result.exit_code or (out / "run.mcap").read_bytes() != content:
            return f"step {at}: {done.result.reason or 'other bytes'}"
        if "fmu" not in done.restored:
            return "no state"
    return f"{len(chosen)} exact"


def check(fmu: Path, checkout: Path, feed: Path | None, work: Path) -> tuple[bool, str]:
    """Run an FMU; return whether all is well, and the row of the table."""
    folder = work / "run"
    if fmu.stem == "Roberts":
        start, h, rows = 1e-5, 0.01, 100
        reference = roberts(start + h * np.arange(rows))
    else:
        reference = read_table(checkout / fmu.stem / f"{fmu.stem}_out.csv")
        start, rows = 0.0, len(reference["time"])
        h = reference["time"][1] - reference["time"][0]
    steps = max(rows - 1, _FEWEST_STEPS)
    result = run(fmu, h, steps, feed, work)
    if result.exit_code:
        return False, f"{fmu.stem}: {result.reason}"
    table = recorded(folder, "fmu", start)
    if feed is not None:
        columns = read_table(feed)
        inputs = [fed(k, columns, h) for k in range(len(table["time"]) - 1)]
        names = {name.replace("input", "output"): name for name in inputs[0]}
        reference = {"time": table["time"], **{
            out: [table[out][0], *(row[name] for row in inputs)]
            for out, name in names.items() if out in table
        }}  # fmt: skip
    problem, share, largest = compare(table, reference)
    ended = "ends itself" if "ends the simulation" in result.reason else ""
    branched = branches(folder, result.steps)
    version = fmpy.read_model_description(fmu).fmiVersion
    name = f"{fmu.stem}{' with inputs' if feed else ''}"
    row = f"{version:4} {name:24} {h:<6.4g} {rows:5} {largest:<10.3g} {share:8.1%}  {branched:9}"
    ok = not problem and branched.endswith("exact")
    return ok, f"{row} {problem or ended}"


# --- two FMUs, and a million steps ----------------------------------------------------------


class End(NamedTuple):
    """One of two FMUs that are coupled: the names of its input and output, real numbers."""

    fmu: Path
    u: str
    y: str


def coupled(ends: tuple[End, End], steps: int, h: float, work: Path) -> tuple[bool, str]:
    """Couple two FMUs both ways; compare with a Jacobi loop over FMPy's calls in this process."""
    names = "first", "second"
    participants = {
        name: {
            "participant": shutil.copy(end.fmu, work / f"{name}.fmu").name,
            "inputs": {"in": {"from": f"{source}.out", "type": "Scalars/1"}},
            "params": {"inputs": {end.u: f"in.{other.y}"}},
        }
        for name, source, end, other in zip(names, names[::-1], ends, ends[::-1], strict=True)
    }
    step = f"{round(h * 1e9)}ns"
    data = {"name": "pair", "step": step, "duration": f"{steps * round(h * 1e9)}ns"}
    wired = stepbus.load({**data, "participants": participants}, folder=work)
    result = stepbus.run(wired, out=work / "run")
    if result.exit_code:
        return False, f"a pair: {result.reason}"
    tables = [recorded(work / "run", name) for name in names]
    found = [table[end.y] for table, end in zip(tables, ends, strict=True)]
    expected = list(zip(*jacobi(ends, steps, h), strict=True))
    same = all(
        struct.pack(f"{steps}d", *one[:steps]) == struct.pack(f"{steps}d", *other)
        for one, other in zip(found, expected, strict=True)
    )
    said = " and ".join(end.fmu.stem for end in ends)
    what = "to the bit as FMPy's loop" if same else f"not as FMPy's loop ({expected[0][-1]!r})"
    return same, f"{said} coupled, {steps} steps: {what}; the last value is {found[0][steps - 1]!r}"


def jacobi(ends: tuple[End, End], steps: int, h: float) -> Iterator[tuple[float, float]]:
    """Yield the outputs of both before each step: both are read, both are set, both step."""
    made = []
    for end in ends:
        description = fmpy.read_model_description(end.fmu)
        fmu = fmpy.instantiate_fmu(
            fmpy.extract(end.fmu), description, "CoSimulation", require_functions=False
        )
        by_name = {item.name: item for item in description.modelVariables}
        is_3 = description.fmiVersion[0] == "3"
        kind = "Float64" if is_3 else "Real"
        places = []
        for name in (end.u, end.y):
            item = by_name[name.partition("[")[0]]
            places.append((item.valueReference, [float(x) for x in (item.start or "0").split()]))
        size = (3,) if end.y.endswith("[1]") else (1,) if is_3 else ()
        made.append((fmu, *places, getattr(fmu, f"get{kind}"), getattr(fmu, f"set{kind}"), size))
        if not is_3:
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
    for k in range(steps):
        y = [get([place[0]], *size)[0] for _, _, place, get, _, size in made]
        yield y[0], y[1]
        for (_, (reference, start), _, _, put, _), value_ in zip(made, y[::-1], strict=True):
            put([reference], [value_, *start[1:]])
        for fmu, *_ in made:
            fmu.doStep(k * h, h)
    for fmu, *_ in made:
        fmu.terminate()
        fmu.freeInstance()


def memory(fmu: Path, steps: int, work: Path) -> tuple[bool, str]:
    """Do many steps in this process; return whether it has grown after the first fifth of them."""
    sizes: list[int] = []
    over = threading.Event()

    def watch() -> None:
        while not over.wait(0.2):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            sizes.append(pages * 4096)

    threading.Thread(target=watch, daemon=True).start()
    result = run(fmu, 1e-3, steps, None, work, in_process=True)
    over.set()
    early, late = sizes[len(sizes) // 5], sizes[-1]
    rate = result.steps / result.wall_s
    text = f"{result.steps} steps of {fmu.stem}: {early / 2**20:.1f} MiB after a fifth of them, "
    ok = not result.exit_code and late - early < _ALLOWED_GROWTH
    return ok, f"{text}{late / 2**20:.1f} MiB at the end ({rate:.0f} steps/s)"


def apart(function: Any, *args: Any) -> tuple[bool, str]:
    """Call a function in a process of its own, since two FMUs may not fit in one."""
    with (
        tempfile.TemporaryDirectory(prefix="fmi-") as folder,
        get_context("spawn").Pool(1) as pool,
    ):
        return pool.apply(caught, (function, *args, Path(folder)))


def caught(function: Any, *args: Any) -> tuple[bool, str]:
    """Call a function; an error is a row of the table."""
    try:
        return function(*args)
    except Exception as exc:  # noqa: BLE001  (whatever it is)
        return False, f"{function.__name__} {args[0]}: {type(exc).__name__}: {exc}"


def main(checkout: Path, folders: Sequence[Path]) -> int:
    """Print the table, and return the exit code."""
    fmus = sorted(fmu for folder in folders for fmu in folder.glob("**/*.fmu"))
    head = f"FMI  model{'':19}  step   rows  largest    outside  branches"
    print(f"{len(fmus)} FMUs of {checkout}\n{head}")
    rows = []
    for fmu in fmus:
        if fmpy.read_model_description(fmu).coSimulation is None:
            print(f"{'':4} {fmu.stem}: no co-simulation")
            continue
        feeds = [None, checkout / "Feedthrough" / "Feedthrough_in.csv"]
        for feed in feeds if fmu.stem == "Feedthrough" else feeds[:1]:
            rows.append(apart(check, fmu, checkout, feed))
            print(rows[-1][1], flush=True)
    has = {
        stem: {f.parent for f in fmus if f.stem == stem} for stem in ("Feedthrough", "StateSpace")
    }
    for folder in sorted(has["Feedthrough"] & has["StateSpace"]):
        ends = (
            End(
                folder / "Feedthrough.fmu", "Float64_continuous_input", "Float64_continuous_output"
            ),
            End(folder / "StateSpace.fmu", "u[1]", "y[1]"),
        )
        rows.append(apart(coupled, ends, 1000, 0.01))
        print(rows[-1][1], flush=True)
    for fmu in (fmu for fmu in fmus if fmu.stem == "Dahlquist"):
        rows.append(apart(memory, fmu, _STEPS))
        print(rows[-1][1], flush=True)
    bad = sum(not ok for ok, _ in rows)
    print(f"{bad} of {len(rows)} failed" if rows else "no FMU found: build them first")
    return int(bad > 0 or not rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("folders", type=Path, nargs="*")
    given = parser.parse_args()
    sys.exit(main(given.checkout, given.folders or [given.checkout]))
