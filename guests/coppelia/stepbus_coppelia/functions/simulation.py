"""The simulation: start and stop, steps, time, scenes, parameters, messages to the user."""

import time
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from stepbus_coppelia.clients import ApiError

from .table import CONSTANTS, function, number

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session

VERSION = 40900
"""The version of CoppeliaSim whose functions these are: 4.9.0."""
_GROUP = "simulation"
_LEVELS = {100: "warning", 200: "error"}


@function(_GROUP)
def start_simulation(sim: "Session") -> int:
    """Start a simulation, which is a run; go on with one that is paused."""
    sim.start()
    return 1


@function(_GROUP)
def stop_simulation(sim: "Session", _wait: bool = False) -> int:
    """Stop it, and turn stepping off for all clients; the run ends."""
    sim.stop()
    return 1


@function(_GROUP)
def pause_simulation(sim: "Session") -> int:
    """Hold it until it is started again."""
    sim.pause()
    return 1


@function(_GROUP)
def get_simulation_state(sim: "Session") -> int:
    """Return `simulation_stopped`, `_paused` or `_advancing_…`."""
    return sim.state


@function(_GROUP)
def get_simulation_time(sim: "Session") -> float:
    """Return the simulation time [s]."""
    return sim.time


@function(_GROUP)
def get_simulation_time_step(sim: "Session") -> float:
    """Return the length of a step, `step` of the scenario [s]."""
    return sim.dt


@function(_GROUP)
def set_stepping(sim: "Session", enable: bool | int = True) -> int:
    """Turn stepping on or off, in levels; return the level before."""
    if sim.client is None:
        raise ApiError("no client.")
    before = sim.client.level
    if isinstance(enable, bool):
        sim.client.level = before + 1 if enable else max(before - 1, 0)
    else:
        sim.client.level = max(int(enable), 0)
    return before


@function(_GROUP, "yield", "switchThread")
def step(sim: "Session", _wait: bool = True) -> None:
    """Let the simulation make a step; return when that is done. Without stepping, at once."""
    if sim.client is not None and sim.is_running:
        sim.client.waits = True


@function(_GROUP)
def get_stepping(sim: "Session") -> bool:
    """Return whether the client steps the simulation."""
    return sim.client is not None and sim.client.level > 0


@function(_GROUP)
def acquire_lock(_sim: "Session") -> None:
    """Do nothing: calls of clients never overlap."""


@function(_GROUP)
def release_lock(_sim: "Session") -> None:
    """Do nothing: calls of clients never overlap."""


@function(_GROUP)
def get_system_time(_sim: "Session") -> float:
    """Return the time of the machine [s]; what depends on it does not repeat."""
    return time.monotonic()


# --- scenes and models ---------------------------------------------------------------------------


@function(_GROUP)
def load_scene(sim: "Session", file: str) -> int:
    """Take another world, as the table `scenes` of the scenario maps the file's name."""
    sim.load_scene(_mapped(sim.params.scenes, file, "scenes"))
    return 1


@function(_GROUP)
def close_scene(sim: "Session") -> int:
    """Take back what the script has changed of the scene."""
    sim.load_scene("")
    return 0


@function(_GROUP)
def load_model(sim: "Session", file: str) -> int:
    """Add a body, as the table `models` of the scenario maps the file's name; return its handle."""
    return sim.load_model(_mapped(sim.params.models, file, "models"), PurePath(file).stem)


def _mapped(table: Any, file: str, key: str) -> Any:
    name = PurePath(str(file).replace("\\", "/")).name
    if name not in table:
        raise ApiError(
            f"{name!r} is a file of CoppeliaSim; map it to a {'world' if key == 'scenes' else 'URDF'} "
            f"under `{key}` of the gateway in the scenario."
        )
    return table[name]


# --- parameters ----------------------------------------------------------------------------------


@function(_GROUP, "getInt32Parameter")
def get_int32_param(sim: "Session", parameter: int) -> int:
    """Return a parameter, such as the version."""
    known = {
        CONSTANTS["intparam_program_version"]: VERSION,
        CONSTANTS["intparam_program_full_version"]: VERSION * 100,
        CONSTANTS["intparam_program_revision"]: 0,
        CONSTANTS["intparam_platform"]: 2,
        CONSTANTS["intparam_idle_fps"]: 8,
    }
    return int(sim.values.get(("int", parameter), known.get(parameter, 0)))


@function(_GROUP)
def get_float_param(sim: "Session", parameter: int) -> float:
    """Return a parameter, such as the length of a step."""
    known = {
        CONSTANTS["floatparam_simulation_time_step"]: sim.dt,
        CONSTANTS["floatparam_physicstimestep"]: sim.dt,
    }
    return float(sim.values.get(("float", parameter), known.get(parameter, 0.0)))


@function(_GROUP)
def set_float_param(sim: "Session", parameter: int, value: float) -> None:
    """Set a parameter; the length of a step only to what it is in the scenario."""
    is_step = parameter == CONSTANTS["floatparam_simulation_time_step"]
    if is_step and abs(number(value) - sim.dt) > 1e-9:
        raise ApiError(
            f"the step of this scenario is {sim.dt:g} s; use `--set step={value * 1e3:g}ms`."
        )
    sim.values["float", parameter] = number(value)


@function(_GROUP, "setInt32Parameter", "setBoolParam", "setStringParam")
def set_int32_param(sim: "Session", parameter: int, value: Any) -> None:
    """Set a parameter, which changes nothing here."""
    kind = "bool" if isinstance(value, bool) else "text" if isinstance(value, str) else "int"
    sim.values[kind, parameter] = value


@function(_GROUP)
def get_bool_param(sim: "Session", parameter: int) -> bool:
    """Return a parameter."""
    return bool(sim.values.get(("bool", parameter), False))


@function(_GROUP)
def get_string_param(sim: "Session", parameter: int) -> str:
    """Return a parameter, such as the path of the scene."""
    file = str(sim.scene.physics.world.source.file)
    known = {
        CONSTANTS["stringparam_scene_path_and_name"]: file,
        CONSTANTS["stringparam_scene_name"]: PurePath(file).name,
        CONSTANTS["stringparam_scene_path"]: str(PurePath(file).parent),
    }
    return str(sim.values.get(("text", parameter), known.get(parameter, "")))


@function(_GROUP)
def get_array_param(sim: "Session", parameter: int) -> list[float]:
    """Return a parameter, such as gravity."""
    is_gravity = parameter == CONSTANTS["arrayparam_gravity"]
    return list(sim.scene.physics.world.gravity) if is_gravity else [0.0, 0.0, 0.0]


@function(_GROUP)
def get_page(_sim: "Session") -> int:
    """Return 0: there is one page."""
    return 0


# --- messages ------------------------------------------------------------------------------------


@function(_GROUP)
def add_log(sim: "Session", verbosity: int, text: str) -> None:
    """Show a message to whoever watches, and record it."""
    sim.log(_LEVELS.get(int(verbosity), "info"), str(text))


@function(_GROUP, "addStatusbarMessage", "auxiliaryConsolePrint")
def _add_statusbar_message(sim: "Session", *words: Any) -> int:
    """Show a message to whoever watches, and record it."""
    sim.log("info", str(words[-1]))
    return 1
