"""The simulation: start and stop, steps, time, scenes, parameters, messages to the user."""

from pathlib import PurePath
from typing import Any

from stepbus_coppelia.clients import ApiError

from .table import CONSTANTS, Group, number

VERSION = 40900
"""The version of CoppeliaSim whose functions these are: 4.9.0."""
_SAYS = {420: "error", 430: "warning", 200: "error", 300: "warning"}


class Simulation(Group):
    """What starts, steps and stops it."""

    title = "the simulation"
    also = {
        "yield": "step",
        "switchThread": "step",
        "releaseLock": "acquireLock",
        "getInt32Parameter": "getInt32Param",
        "setInt32Parameter": "setFloatParam",
        **{f"set{k}Param": "setFloatParam" for k in ("Int32", "Bool", "String")},
    }

    def startSimulation(self) -> None:
        """Start a simulation, which is a run; go on with one that is paused."""
        self.sim.start()

    def stopSimulation(self, _wait: bool = False) -> None:
        """Stop it, and turn stepping off for all clients; the run ends."""
        self.sim.stop()

    def pauseSimulation(self) -> None:
        """Hold it until it is started again."""
        self.sim.pause()

    def getSimulationState(self) -> int:
        """Return `simulation_stopped`, `_paused` or `_advancing_…`."""
        return self.sim.state

    def getSimulationTime(self) -> float:
        """Return the simulation time [s]."""
        return self.sim.time

    def getSimulationTimeStep(self) -> float:
        """Return the length of a step, `step` of the scenario [s]."""
        return self.sim.dt

    def setStepping(self, enable: bool | int = True) -> int:
        """Turn stepping on or off, in levels; return the level before."""
        client = self.sim.client
        before, client.level = client.level, max(client.level + (1 if enable else -1), 0)
        return before

    def step(self, _wait: bool = True) -> None:
        """Let the simulation make a step; return when that is done."""
        self.sim.client.waits = self.sim.is_running

    def wait(self, seconds: float, is_simulated: bool = True) -> float:
        """Return when so much simulation time has passed [s]."""
        if self.sim.is_running and is_simulated:
            self.sim.client.until = self.sim.time + number(seconds)
            self.sim.client.waits = True
        return 0.0

    def acquireLock(self) -> None:
        """Do nothing: calls of clients never overlap."""

    def loadScene(self, file: str) -> int:
        """Take another world, as the table `scenes` of the scenario maps the file's name."""
        self.sim.scene.load_world(_mapped(self.sim.params.scenes, file, "a world under `scenes`"))
        return 1

    def loadModel(self, file: str) -> int:
        """Add a body, as the table `models` maps the file's name; return its handle."""
        urdf = _mapped(self.sim.params.models, file, "a URDF under `models`")
        return self.sim.scene.load_model(urdf, PurePath(file).stem)

    def getInt32Param(self, parameter: int) -> int:
        """Return a parameter, such as the version."""
        known = {"program_version": VERSION, "program_full_version": VERSION * 100}
        known |= {"platform": 2, "idle_fps": 8}
        return int(self._param("intparam_", parameter, known, 0))

    def getFloatParam(self, parameter: int) -> float:
        """Return a parameter, such as the length of a step."""
        known = dict.fromkeys(("simulation_time_step", "physicstimestep"), self.sim.dt)
        return float(self._param("floatparam_", parameter, known, 0.0))

    def getBoolParam(self, parameter: int) -> bool:
        """Return a parameter."""
        return bool(self._param("boolparam_", parameter, {}, False))

    def getStringParam(self, parameter: int) -> str:
        """Return a parameter, such as the path of the scene."""
        file = PurePath(self.sim.scene.physics.world.source.file)
        known = {"path_and_name": str(file), "name": file.name, "path": str(file.parent)}
        return str(self._param("stringparam_scene_", parameter, known, ""))

    def _param(self, kind: str, parameter: int, known: Any, default: Any) -> Any:
        own = {CONSTANTS[kind + name]: value for name, value in known.items()}
        return self.sim.values.get((kind[0], parameter), own.get(parameter, default))

    def setFloatParam(self, parameter: int, value: Any) -> int:
        """Set a parameter, for `get…Param`; the length of a step only to what it is."""
        is_step = parameter == CONSTANTS["floatparam_simulation_time_step"]
        if is_step and isinstance(value, float) and abs(number(value) - self.sim.dt) > 1e-9:
            own, wanted = f"{self.sim.dt:g} s", f"`--set step={value * 1e3:g}ms`"
            raise ApiError(f"the step of this scenario is {own}; use {wanted}.")
        self.sim.values[type(value).__name__[0], parameter] = value
        return 1

    def addLog(self, verbosity: int, text: str) -> None:
        """Show a message to whoever watches, and record it."""
        self.sim.logged.append((_SAYS.get(int(verbosity), "info"), str(text)))


def _mapped(table: Any, file: str, what: str) -> Any:
    name = PurePath(str(file).replace("\\", "/")).name
    if name not in table:
        why = f"{name!r} is a file of CoppeliaSim; map it to {what} of the gateway in the scenario."
        raise ApiError(why)
    return table[name]
