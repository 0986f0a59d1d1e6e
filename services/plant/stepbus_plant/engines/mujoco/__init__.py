"""MuJoCo: exact states with contacts, and wheels for every current Python."""

from stepbus_plant.engines.mujoco.engine import MujocoEngine

ENGINE = MujocoEngine
