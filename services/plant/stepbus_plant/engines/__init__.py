"""The physics engines: one module each, which is loaded when a world asks for it."""

from importlib import import_module
from importlib.util import find_spec
from typing import get_args

from stepbus_plant.engine import Engine
from stepbus_plant.world import EngineName
from stepbus_schemas import Point, WiringError

ENGINES: tuple[EngineName, ...] = get_args(EngineName)
"""The default is the first that is installed."""


def is_here(name: str) -> bool:
    """Return whether the package of an engine is installed."""
    return find_spec(name) is not None


def default_engine() -> EngineName:
    """Return the engine of worlds that name none."""
    return next(filter(is_here, ENGINES), ENGINES[0])


def open_engine(name: EngineName, step_s: float, gravity: Point, solver_iterations: int) -> Engine:
    """Return an empty world in an engine.

    step_s: length of a physics substep [s]. gravity: [m/s²]. Raises WiringError when the engine is
    not installed.
    """
    if not is_here(name):
        here = [other for other in ENGINES if is_here(other)]
        instead = f", or use engine {here[0]}" if here else ""
        raise WiringError(f"engine {name} is not installed; run `pip install {name}`{instead}")
    made: Engine = import_module(f"stepbus_plant.engines.{name}").ENGINE(
        step_s, gravity, solver_iterations
    )
    return made
