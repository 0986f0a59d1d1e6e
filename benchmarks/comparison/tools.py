"""The tools that `run.py` compares: what to install, what to start, and where the recording is."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
CHECKOUT = HERE.parents[1]


@dataclass(frozen=True, kw_only=True)
class Tool:
    """One tool with its own solution of the task, in the folder `name`."""

    name: str
    packages: tuple[str, ...]
    """For pip, with versions; none: the environment that runs this."""
    shows: tuple[str, ...]
    """Those whose versions the page shows."""
    command: tuple[str, ...]
    guarded: tuple[str, ...] = ()
    """The same with a time limit that the tool offers, where it has none by default."""
    guard: str = ""
    """That limit, as the page names it."""
    prepare: tuple[tuple[str, ...], ...] = ()
    """Commands before each run, such as a build."""
    replay: tuple[tuple[str, ...], ...] = ()
    """Commands that compute the controller's outputs again from the recording."""
    code: tuple[str, ...]
    """Files that a user writes to run the task."""
    record: tuple[str, ...] = ()
    """Files that a user writes so that the run is recorded."""
    recording: str = ""
    """Pattern of the file with the recording, below the folder of the run."""
    steps: Callable[[Path], int] | None = None
    """How many complete steps a recording has."""


def _lines(path: Path, *, less: int = 0) -> int:
    return max(path.read_text(errors="replace").count("\n") - less, 0)


def _helics_steps(path: Path) -> int:
    """Return the number of torques: those of step k come after the states."""
    return path.read_text(errors="replace").count("\ttorque\t")


def _mcap_steps(path: Path) -> int:
    import stepbus  # noqa: PLC0415  of this tool only

    with stepbus.Recording(path) as recording:
        return sum(1 for _ in recording["controller.command"].maps())


MOSAIK = Tool(
    name="mosaik",
    packages=("mosaik==3.6.0",),
    shows=("mosaik",),
    command=("python", "scenario.py"),
    code=("plant.py", "controller.py", "scenario.py"),
    record=("collector.py",),
    recording="recording.csv",
    steps=_lines,
)
HELICS = Tool(
    name="helics",
    packages=("helics[cli]==3.6.1",),
    shows=("helics",),
    command=("helics", "run", "--path=federation.json"),
    guarded=("helics", "run", "--path=federation_guarded.json"),
    guard="`helics_broker --maxcosimduration=10s`",
    replay=(
        ("sh", "-c", "grep -v torque recording.txt > state.txt"),
        ("helics", "run", "--path=replay.json"),
    ),
    code=("federate.py", "plant.py", "controller.py", "federation.json"),
    record=("recorder.json",),
    recording="recording.txt",
    steps=_helics_steps,
)
DORA = Tool(
    name="dora",
    packages=("dora-rs==1.1.0", "dora-rs-cli==1.1.0", "pyarrow==26.0.1", "numpy==2.4.6"),
    shows=("dora-rs", "dora-rs-cli"),
    command=("dora", "run", "dataflow.yml"),
    guarded=("dora", "run", "dataflow_guarded.yml"),
    guard="`health_check_timeout: 3.0`",
    code=("plant.py", "controller.py", "dataflow.yml"),
)
FMI = Tool(
    name="fmi",
    packages=("libcosimpy==0.0.6", "fmpy==0.3.32", "pythonfmu==0.7.0"),
    shows=("libcosimpy", "FMPy", "pythonfmu"),
    command=("python", "master.py", ".", "logs"),
    prepare=(
        ("pythonfmu", "build", "-f", "plant.py", "arm.py"),
        ("pythonfmu", "build", "-f", "controller.py", "arm.py"),
        ("mkdir", "logs"),
    ),
    replay=(("python", "replay.py", "Controller.fmu", "logs"),),
    code=("plant.py", "controller.py", "master.py"),
    recording="logs/plant_*.csv",
    steps=lambda path: _lines(path, less=2),
)
PYBULLET = Tool(
    name="pybullet_gymnasium",
    packages=("gymnasium==1.4.0", "pybullet==3.2.7", "numpy==2.4.6"),
    shows=("gymnasium", "pybullet"),
    command=("python", "controller.py"),
    code=("plant.py", "controller.py", "arm.urdf"),
    recording="episode.npz",
)
STEPBUS = Tool(
    name="stepbus",
    packages=(),
    shows=("stepbus", "eclipse-zenoh"),
    command=("stepbus", "run", ".", "--out", "run", "--no-report"),
    replay=(("stepbus", "replay", "run/run.mcap", "--participant", "controller"),),
    code=("plant.py", "controller.py", "scenario.yaml"),
    recording="run/run.mcap",
    steps=_mcap_steps,
)
TOOLS = (STEPBUS, MOSAIK, HELICS, DORA, FMI, PYBULLET)


def interpreter(tool: Tool, environments: Path) -> Path:
    """Return the Python of a tool."""
    return environments / tool.name / "bin/python" if tool.packages else Path(sys.executable)
