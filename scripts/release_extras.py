"""What each extra promises: it is installed into an empty environment, and used."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from scripts.release_build import ROOT, Failed
from scripts.release_venv import (
    Environment,
    assert_equal,
    hash_of,
    installed,
    try_view,
)

USES = ROOT / "scripts/release_uses"
RECORDING = ROOT / "tests/scenarios/golden/two_link.mcap"
SHORT = ("--set", "duration=200ms", "--no-report")
Use = Callable[[Environment, Path], str]

NOTHING_MORE = """
import importlib.metadata, stepbus
from stepbus import Config, JointCommand, Participant, Step

class Mine(Participant):
    def update(self, step):
        return {}

ours = {"pip", "setuptools", "stepbus"}
print(*sorted({d.metadata["Name"] for d in importlib.metadata.distributions()} - ours))
"""
FRAME = """
import stepbus
frame = stepbus.Recording("run.mcap").frame("plant/joint_state")
print(type(frame).__module__.partition(".")[0], len(frame) > 0)
"""
EPISODE = """
import gymnasium
from stepbus_gym import StepbusEnv
env = StepbusEnv("scenario.yaml", participant="controller", duration="100ms",
                 reward=lambda moment: moment.t, limits={"command.values": (-5, 5)})
observation, _ = env.reset(seed=1)
env.action_space.seed(1)
steps, ended = 0, False
while not ended:
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    steps, ended = steps + 1, terminated or truncated
env.close()
print(isinstance(env, gymnasium.Env), steps >= 19)
"""
MADE = """
import gymnasium, stepbus_gym
env = gymnasium.make("stepbus/two_link-v0")
env.reset(seed=1)
env.step(env.action_space.sample())
env.close()
"""


def use_none(environment: Environment, folder: Path) -> str:
    """Write a participant; what needs an extra says which one."""
    listed = environment.run("python", "-c", NOTHING_MORE, cwd=folder).split()
    assert_equal("the packages of an installation without extras", listed,
                 ["eclipse-zenoh", "msgspec"])  # fmt: skip
    said = environment.run("!stepbus", "run", "two_link", cwd=folder)
    if "Traceback" in said or "pip install" not in said:
        raise Failed(f"without the extra `run`, `stepbus run` does not name it:\n{said}")
    return "2 packages; `stepbus run` names the extra that it needs"


def use_run(environment: Environment, folder: Path) -> str:
    """Run participants that need nothing else, and repeat the run from its recording."""
    said = environment.run("stepbus", "run", "scenario.yaml", "--out", "a", cwd=folder)
    environment.run("stepbus", "rerun", "a", "--out", "b", cwd=folder)
    environment.run("stepbus", "diff", "a", "b", cwd=folder)
    environment.run("stepbus", "validate", "scenario.yaml", cwd=folder)
    return f"run, rerun, diff, validate; messages {hash_of(said)[:12]}…"


def use_sim(environment: Environment, folder: Path) -> str:
    """Run the arm with the engine of this Python."""
    said = environment.run("stepbus", "run", "two_link", *SHORT, cwd=folder)
    return f"run two_link; messages {hash_of(said)[:12]}…"


def use_mujoco(environment: Environment, folder: Path) -> str:
    """Run the arm with MuJoCo."""
    engine = ("--set", "plant.params.engine=mujoco")
    said = environment.run("stepbus", "run", "two_link", *SHORT, *engine, cwd=folder)
    return f"run two_link with MuJoCo; messages {hash_of(said)[:12]}…"


def use_report(environment: Environment, folder: Path) -> str:
    """Write report.html and a plot of a recording."""
    environment.run("stepbus", "report", "run.mcap", "--out", "r.html", cwd=folder)
    signal = "plant.joint_state.position[0]"
    environment.run("stepbus", "plot", "run.mcap", signal, "--out", "p.png", cwd=folder)
    return _written(folder, "r.html", "p.png")


def use_export(environment: Environment, folder: Path) -> str:
    """Write every format that needs no other extra, and make a table of pandas."""
    targets = {
        "--csv": "all.csv",
        "--parquet": "tables",
        "--foxglove": "f.mcap",
        "--ros2": "r.mcap",
    }
    for option, target in targets.items():
        environment.run("stepbus", "export", "run.mcap", option, target, cwd=folder)
    said = environment.run("python", "-c", FRAME, cwd=folder).split()
    assert_equal("Recording.frame", said, ["pandas", "True"])
    environment.run("python", "-c", "import av, websockets", cwd=folder)
    return _written(folder, *targets.values())


def use_rerun(environment: Environment, folder: Path) -> str:
    """Write the file of Rerun."""
    environment.run("stepbus", "export", "run.mcap", "--rerun", "r.rrd", cwd=folder)
    return _written(folder, "r.rrd")


def use_view(environment: Environment, folder: Path) -> str:
    """Write the scene in motion as one page."""
    environment.run("stepbus", "export", "run.mcap", "--scene", "scene.html", cwd=folder)
    return _written(folder, "scene.html")


def use_sweep(environment: Environment, folder: Path) -> str:
    """Sweep a parameter over two processes, with a metric."""
    axis = ("--vary", "controller.params.gain=1,2,3", "--metric", "final.py:final")
    environment.run("stepbus", "sweep", "scenario.yaml", *axis, "--out", "swept", cwd=folder)
    return _written(folder, "swept/results.parquet", "swept/report.html")


def use_gym(environment: Environment, folder: Path) -> str:
    """Play an episode."""
    said = environment.run("python", "-c", EPISODE, cwd=folder).split()
    assert_equal("an episode", said, ["True", "True"])
    return "an episode to its end"


def use_quick_start(environment: Environment, folder: Path) -> str:
    """Do what getting_started.md and reports.md do, and what the action does with a difference."""
    environment.run("stepbus", "run", "two_link", *SHORT[:2], "--out", "arm", cwd=folder)
    environment.run("stepbus", "report", "arm", cwd=folder)
    replay = ("replay", "arm", "--participant", "controller", "--update", "new.mcap")
    environment.run("stepbus", *replay, cwd=folder)
    environment.run("stepbus", "report", "arm", "new.mcap", "--out", "both.html", cwd=folder)
    environment.run("stepbus", "new", "own", cwd=folder)
    environment.run("stepbus", "run", "own", *SHORT[:2], cwd=folder)
    return _written(folder, "arm/report.png", "arm/report.html", "both.html")


def use_viewing(environment: Environment, folder: Path) -> str:
    """Do what viewing.md does."""
    environment.run("stepbus", "run", "two_link", *SHORT, "--out", "viewed", cwd=folder)
    environment.run("stepbus", "export", "viewed", "--scene", "scene.html", cwd=folder)
    return f"{_written(folder, 'scene.html')}; view: {try_view(environment, folder, 'viewed')}"


def use_sweeps(environment: Environment, folder: Path) -> str:
    """Do what sweeps.md does, and repeat a run."""
    axis = ("--vary", "controller.params.kp=50:200:2", "--set", SHORT[1])
    environment.run("stepbus", "sweep", "two_link", *axis, "--out", "swept", cwd=folder)
    environment.run("stepbus", "rerun", "swept", "1", cwd=folder)
    return _written(folder, "swept/results.parquet", "swept/report.html")


def use_gymnasium(environment: Environment, folder: Path) -> str:
    """Do what gymnasium.md does."""
    environment.run("python", "-c", MADE, cwd=folder)
    return "an environment by its name"


EXTRAS: Mapping[str, tuple[str, Use]] = {
    "none": ("", use_none),
    "run": ("run", use_run),
    "sim": ("sim", use_sim),
    "mujoco": ("mujoco", use_mujoco),
    "report": ("report", use_report),
    "export": ("export", use_export),
    "rerun": ("rerun", use_rerun),
    "view": ("view", use_view),
    "sweep": ("sweep", use_sweep),
    "gym": ("gym", use_gym),
    "quick-start": ("sim,report", use_quick_start),
    "viewing": ("sim,view", use_viewing),
    "sweeps": ("sim,sweep", use_sweeps),
    "gymnasium": ("gym,sim", use_gymnasium),
}
"""Name → what is installed, and what is done with it; the last four: as a page says."""


def try_extra(name: str, place: Path, wheel: Path, python: str, cache: Path) -> str:
    """Install an extra into an empty environment and use it; return what it did; raises Failed."""
    extras, use = EXTRAS[name]
    environment = installed(place, wheel, extras, python, cache)
    folder = environment.work("work")
    for file in USES.iterdir():
        if file.is_file():
            shutil.copy(file, folder / file.name)
    shutil.copy(RECORDING, folder / "run.mcap")
    return use(environment, folder)


def _written(folder: Path, *names: str) -> str:
    """Return what was written; raises Failed for a file that is missing or empty."""
    for name in names:
        path = folder / name
        if not path.exists() or (path.is_file() and not path.stat().st_size):
            raise Failed(f"{name} was not written")
    return "wrote " + ", ".join(names)
