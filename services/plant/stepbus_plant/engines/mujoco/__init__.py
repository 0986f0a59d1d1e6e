"""MuJoCo: exact states with contacts, and wheels for every current Python."""

import contextlib
import os

# With a renderer that is not there, MuJoCo itself could not be loaded, even without any camera.
with contextlib.ExitStack() as after:
    if (renderer := os.environ.pop("MUJOCO_GL", None)) is not None:
        after.callback(os.environ.__setitem__, "MUJOCO_GL", renderer)
    from stepbus_plant.engines.mujoco.mujoco_engine import MujocoEngine

ENGINE = MujocoEngine
