"""A robot in stepbus: its numbers beside those of the libraries, and a run."""

import json
import math
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scripts.robots.libraries import Library, Pose, Values

import stepbus
from stepbus_kinematics import RobotModel
from stepbus_participant import package_path
from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.poses import PoseSensor

POSES, STEP, G = 20, 1e-3, 9.81
_FLOOR = """<robot name="floor"><link name="floor"><collision><origin xyz="0 0 -0.5"/><geometry>
<box size="20 20 1"/></geometry></collision></link></robot>"""
_LOOSE = {"mimic": False, "lower": -9, "upper": 9}
_CONTROLLER = """
  controller:
    participant: stepbus_controller:Controller
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1, status: ControllerStatus/1}
    params: {law: computed_torque, kp: 100, kd: 20, effort_limit: 100000, model: "%s"}
  mission:
    participant: stepbus_mission:Mission
    outputs: {reference: JointReference/1}
    params: %s"""
_PLANT = """
name: robot
step: 5ms
duration: 2s
participants:
  plant:
    participant: stepbus_plant:Plant
    publishes: first
    inputs: {%s}
    outputs: {%s}
    params: {world: world.yaml}"""


class Case:
    """A robot in one engine, in a folder of its own. url: `package://…` of its file."""

    def __init__(self, url: str, engine: str, library: Library, folder: Path) -> None:
        self.url, self.engine, self.library, self.folder = url, engine, library, folder

    # --- files --------------------------------------------------------------------------------

    def write_world(
        self, *, joints: Mapping[str, Any] = {}, mode: str = "torque", height: float | None = None
    ) -> None:
        """Write the world file; height: of the root above a floor [m]; None: it is fixed."""
        robot = {"urdf": self.url, "fixed_base": height is None, "position": [0, 0, height or 0]}
        robot |= {"joints": joints, "joint_defaults": {"mode": mode, "effort": 1e5}}
        world = {"engine": self.engine, "physics_step": "1ms", "bodies": {"robot": robot}}
        if height is not None:
            (self.folder / "floor.urdf").write_text(_FLOOR)
            world["bodies"]["floor"] = {"urdf": "floor.urdf", "fixed_base": True}
            world["contacts"] = {"soles": {"links": ["floor"]}}
        (self.folder / "world.yaml").write_text(json.dumps(world))

    def _write_scenario(self, outputs: str, inputs: str = "", others: str = "") -> None:
        text = _PLANT % (inputs, outputs) + others
        (self.folder / "scenario.yaml").write_text(text)

    def _plant(self, **keys: Any) -> SimulatedPlant:
        self.write_world(**keys)
        world = load_world(self.folder / "world.yaml")
        return SimulatedPlant(world, Params.of({"world": "world.yaml"}), round(STEP * 1e9), 0)

    def refusal(self) -> str:
        """Return what `stepbus validate` finds; empty: nothing."""
        self.write_world()
        self._write_scenario("joint_state: JointState/1")
        words = [Path(sys.executable).with_name("stepbus"), "validate", self.folder]
        done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=300)
        return done.stderr if done.returncode else ""

    # --- numbers ------------------------------------------------------------------------------

    def compare(self) -> dict[str, float]:
        """Return the largest difference of each quantity from the library's, in SI units."""
        library, plant = self.library, self._plant()
        limits = plant.joints.description.limits
        rows = zip(plant.names, limits["lower"], limits["upper"], strict=True)
        pairs = [(library.limits[name], stops) for name, *stops in rows if name in library.limits]
        # Not infinite, so that they can be subtracted.
        theirs, ours = np.clip(pairs, -1e9, 1e9).swapaxes(0, 1)
        row = {"limits": float(np.abs(ours - theirs).max()), **self._poses(plant)}
        plant.close()
        plant = self._plant(joints=dict.fromkeys(library.mimics, _LOOSE))
        row["torque"] = max(self._missing(plant), default=math.nan)
        plant.close()
        plant = self._plant(height=10.0 if library.floats else None)
        engine = plant.physics.engine
        row["mass"] = abs(sum(map(engine.mass, engine.links(0).values())) - library.mass)
        plant.close()
        return row

    def _stops(self, plant: SimulatedPlant) -> tuple[list[str], Any, Any]:
        """Return the joints that follow none, and their stops within ±π, shape (n,) each."""
        limits = plant.joints.description.limits
        rows = zip(plant.names, limits["lower"], limits["upper"], strict=True)
        own = {name: stops for name, *stops in rows if name not in self.library.mimics}
        low, high = np.clip(list(own.values()), -np.pi, np.pi).T
        return list(own), low, high

    def _samples(self, plant: SimulatedPlant) -> Iterator[dict[str, float]]:
        """Yield random positions of the joints that follow none."""
        names, low, high = self._stops(plant)
        random = np.random.default_rng(0)
        for _ in range(POSES):
            q = low + random.uniform(0.05, 0.95, len(names)) * (high - low)
            yield dict(zip(names, q.tolist(), strict=True))

    def _poses(self, plant: SimulatedPlant) -> dict[str, float]:
        """Return the largest differences that need no motion, of the plant and of RobotModel.

        Those of RobotModel are nan where it refuses the file.
        """
        sensor, rows = PoseSensor(plant.physics), []
        try:
            model = RobotModel(package_path(self.url))
        except stepbus.WiringError:
            model = None
        for q in self._samples(plant):
            command(plant, "teleport", q)
            followed = self.library.followers(q)
            here = dict(zip(plant.names, plant.sense().position, strict=True))
            slips = [abs(here[name] - value) for name, value in followed.items()]
            poses, theirs = sensor.sense(), self.library.poses(q)
            turns = [pin.Quaternion(np.array(turn)).normalized() for turn in poses.orientation]
            seen = zip(sensor.names, zip(poses.position, turns, strict=True), strict=True)
            torque = self.library.projected(self.library.holding(q))
            row = {
                "mimic": max(slips, default=0.0),
                "poses": apart(theirs, {name: (p, turn.matrix()) for name, (p, turn) in seen}),
                "largest torque": max(map(abs, torque.values())),
                "model poses": np.nan,
                "model torque": np.nan,
            }
            if model is not None:
                at, wanted = (np.array([by[n] for n in model.joints]) for by in (q, torque))
                frames = [(f.translation, f.rotation) for f in model.frame_poses(at, list(theirs))]
                row["model poses"] = apart(theirs, dict(zip(theirs, frames, strict=True)))
                row["model torque"] = np.abs(model.gravity_torque(at) - wanted).max()
            rows.append(row)
        return {key: float(max(row[key] for row in rows)) for key in rows[0]}

    def _missing(self, plant: SimulatedPlant) -> Iterator[float]:
        """Yield what is missing at rest where nothing touches, with the library's torques [N·m]."""
        for q in self._samples(plant):
            if self.library.touches(q):
                continue
            command(plant, "teleport", {**q, **self.library.followers(q)})
            command(plant, "torque", self.library.holding(q))
            plant.advance()
            rates = zip(plant.names, plant.sense().velocity, strict=True)
            missing = self.library.moving({name: rate / STEP for name, rate in rates})
            yield max(map(abs, missing.values()))

    # --- a run --------------------------------------------------------------------------------

    def run(self, *, on_floor: bool) -> dict[str, Any]:
        """Describe the robot and run it for 2 s: held in its pose on a floor, or with sines.

        Returns the joints' positions, the largest error of the followers, and of tracking; or the
        mean force on the floor in the last half second, in weights of the robot.
        """
        (self._stand if on_floor else self._move)()
        stepbus.describe(self.folder)
        result = stepbus.run(self.folder, out=self.folder / "run")
        if result.exit_code:
            raise stepbus.RunFailure(result.reason)
        with stepbus.Recording(result) as recording:
            state = recording["plant.joint_state"]
            joints = {name: state.position[:, n] for n, name in enumerate(state.names)}
            slips = [np.abs(joints[k] - v).max() for k, v in self.library.followers(joints).items()]
            row = {"joints": joints, "slip": max(slips, default=0.0)}
            if on_floor:
                pushes = (
                    m.impulse for step, m in recording["plant.soles"].messages() if step > 300
                )
                return {**row, "weight": sum(map(sum, pushes)) / 0.5 / (G * self.library.mass)}
            errors = (m.error for _, m in recording["controller.status"].messages())
            return {**row, "tracking": np.abs(list(errors)).max()}

    def _stand(self) -> None:
        plant = self._plant()
        engine = plant.physics.engine
        solid = [link for link in engine.links(0).values() if engine.is_solid(link)]
        lowest = min(engine.box(link)[0][2] for link in solid)
        plant.close()
        self.write_world(height=0.01 - lowest, mode="position")
        self._write_scenario("joint_state: JointState/1, soles: Contacts/1")

    def _move(self) -> None:
        plant = self._plant()
        names, low, high = self._stops(plant)
        plant.close()
        swing, middle = np.minimum((high - low) / 8, 0.1), (low + high) / 2
        start = {
            name: {"position": value} for name, value in by_name(names, middle + swing).items()
        }
        self.write_world(joints=start)
        task = {"task": "sine", "joints": names, "omega": 3, "phase": math.pi / 2}
        task |= {"amplitude": by_name(names, swing), "offset": by_name(names, middle)}
        others = _CONTROLLER % (self.url, json.dumps(task))
        self._write_scenario("joint_state: JointState/1", "command: controller.command", others)


def by_name(names: Sequence[str], values: Any) -> dict[str, float]:
    """Return numbers by name."""
    return dict(zip(names, map(float, values), strict=True))


def command(plant: SimulatedPlant, mode: Any, values: Values) -> None:
    """Command joints of a plant by name."""
    message = stepbus.JointCommand(mode=mode, values=[float(value) for value in values.values()])
    plant.commander("command", list(values)).apply(message)


def apart(links: Mapping[str, Pose], others: Mapping[str, Pose]) -> float:
    """Return the largest difference of positions [m] and rotation matrices."""
    rows = (zip(links[name], others[name], strict=True) for name in links)
    return max(float(np.abs(one - other).max()) for row in rows for one, other in row)
