"""What each extra promises: it is installed into an empty environment, and used."""

import shlex
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scripts.release_build import ROOT, Failed
from scripts.release_venv import installed

USES = ROOT / "scripts/release_uses"
RECORDING = ROOT / "tests/scenarios/golden/two_link.mcap"
SHORT = "--set duration=200ms"
GAINS = "--vary controller.params.gain=1,2,3"


@dataclass(frozen=True, kw_only=True)
class Use:
    """What is done with extras: commands in a folder with `USES` and a recording, `run.mcap`.

    writes: files and folders that come of it.
    """

    extras: str
    commands: tuple[str, ...]
    writes: tuple[str, ...] = ()


EXTRAS: Mapping[str, Use] = {
    "none": Use(extras="", commands=("python only_core.py",)),
    "run": Use(
        extras="run",
        commands=(
            "stepbus run scenario.yaml --out a",
            "stepbus rerun a --out b",
            "stepbus diff a b",
            "stepbus validate scenario.yaml",
        ),
    ),
    "sim": Use(extras="sim", commands=(f"stepbus run two_link {SHORT} --no-report",)),
    "mujoco": Use(
        extras="mujoco",
        commands=(f"stepbus run two_link {SHORT} --no-report --set plant.params.engine=mujoco",),
    ),
    "report": Use(
        extras="report",
        commands=(
            "stepbus report run.mcap --out r.html",
            "stepbus plot run.mcap plant.joint_state.position[0] --out p.png",
        ),
        writes=("r.html", "p.png"),
    ),
    "export": Use(
        extras="export",
        commands=(
            "stepbus export run.mcap --csv all.csv",
            "stepbus export run.mcap --parquet tables",
            "stepbus export run.mcap --ros2 r.mcap",
            "python frame.py",
            "python -c 'import av'",
        ),
        writes=("all.csv", "tables", "r.mcap"),
    ),
    "rerun": Use(
        extras="rerun", commands=("stepbus export run.mcap --rerun r.rrd",), writes=("r.rrd",)
    ),
    "view": Use(
        extras="view",
        commands=("stepbus export run.mcap --scene scene.html",),
        writes=("scene.html",),
    ),
    "sweep": Use(
        extras="sweep",
        commands=(f"stepbus sweep scenario.yaml {GAINS} --metric final.py:final --out swept",),
        writes=("swept/results.parquet", "swept/report.html"),
    ),
    "cluster": Use(
        extras="cluster", commands=("python -c 'import stepbus_tools.sweep.ray_workers, ray'",)
    ),
    "gym": Use(extras="gym", commands=("python episode.py",)),
}


def try_extra(name: str, place: Path, wheel: Path, cache: Path) -> str:
    """Install extras into an empty environment and use them; return what it did; raises Failed."""
    use = EXTRAS[name]
    environment = installed(place, wheel, use.extras, cache)
    folder = environment.work("work")
    shutil.copytree(USES, folder, dirs_exist_ok=True)
    shutil.copy(RECORDING, folder / "run.mcap")
    for command in use.commands:
        environment.run(*shlex.split(command), cwd=folder)
    for written in use.writes:
        path = folder / written
        if not path.exists() or (path.is_file() and not path.stat().st_size):
            raise Failed(f"{written} was not written")
    return f"{len(use.commands)} commands"
