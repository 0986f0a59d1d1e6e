"""MuJoCo: exact states with contacts, and wheels for every current Python."""

import os

# With a renderer that is not there, MuJoCo itself could not be loaded, even without any camera.
_RENDERER = os.environ.pop("MUJOCO_GL", None)
try:
    from stepbus_plant.engines.mujoco.engine import MujocoEngine
finally:
    if _RENDERER is not None:
        os.environ["MUJOCO_GL"] = _RENDERER

ENGINE = MujocoEngine
