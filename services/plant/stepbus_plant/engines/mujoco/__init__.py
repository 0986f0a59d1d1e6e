"""MuJoCo: exact states with contacts, and wheels for every current Python."""

from stepbus_participant import variables

# With a renderer that is not there, MuJoCo itself could not be loaded, even without any camera.
with variables({"MUJOCO_GL": None}):
    from stepbus_plant.engines.mujoco.engine import MujocoEngine

ENGINE = MujocoEngine
