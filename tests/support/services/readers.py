"""Readers of robots, each by itself and as stepbus uses it: what they make of one file.

A probe is a method that builds a world of the file, measures, and returns a number or a word; None,
if there is nothing to measure. A reader that lacks a probe leaves that cell of the page empty.
"""

import math
from importlib.metadata import version

import numpy as np

from stepbus_plant.engine import BASE, Light
from stepbus_plant.geometry import projection_matrix, view_matrix

from .mechanics import FLOOR, STEP, Row, advance, command, fixed, make, sensed, state

EYE = view_matrix((0.0, 0.0, 0.0), 3.0, math.pi / 2, 0.0), projection_matrix(1.0, 1.0, 0.1, 10.0)
FLAT = Light(direction=(0, 0, 1), distance=1, ambient=1, diffuse=0, specular=0, has_shadow=False)
G = 9.81
PIXELS = 8
SHOWN_GROUPS = 3
"""Of MuJoCo's shapes, from the start."""
TOP = 5.0
"""From where rays look down [m]."""


class Reader:
    """Probes that follow from others. file: the robot."""

    package = ""

    def __init__(self, file):
        self.file = file

    @classmethod
    def version(cls):
        return version(cls.package)

    def position(self, **given):
        """Return the position of the joint `hinge` after a push [rad or m]."""
        return self.push(**given)[0]

    def velocity(self, **given):
        return self.push(**given)[1]

    def acceleration(self, torque=0.0):
        return self.push(torque, seconds=STEP)[1] / STEP

    def moment(self):
        """Return the moment of inertia about `hinge`, whose axis is vertical [kg·m²]."""
        found = self.acceleration(1.0)
        return 1.0 / found if found else math.inf

    def rest(self, nominal, **given):
        """Return how much higher than its nominal height the body comes to rest [mm]."""
        return 1000.0 * (self.fall(**given)[-1][2] - nominal)

    def rebound(self, **given):
        """Return how far the body rises from where it was lowest [cm]."""
        heights = [row[2] for row in self.fall(**given)]
        lowest = int(np.argmin(heights))
        return 100.0 * (max(heights[lowest:]) - heights[lowest])

    def way(self, **given):
        """Return how far the body gets along x [m]."""
        return self.fall(**given)[-1][0]

    def colour(self):
        """Return the name of the colour in the middle of an image, `nothing` for the background."""
        found = self.pixel()
        if found is None:
            return "nothing"
        red, green, blue = found
        if red == green == blue:
            return "white" if red > 150 else "grey" if red else "black"
        return "red" if red > 100 > max(green, blue) else f"{red} {green} {blue}"


class Bullet(Reader):
    """PyBullet by itself, with the inertias of the file, which it otherwise replaces."""

    package = "pybullet"

    def __init__(self, file):
        from pybullet_utils.bullet_client import BulletClient

        super().__init__(file)
        self.p = BulletClient()
        self.p.setTimeStep(STEP)
        self.p.setGravity(0, 0, -G)
        self.p.setAdditionalSearchPath(str(file.parent))

    def load(self, file=None, at=(0, 0, 0), *, base=True):
        flags = self.p.URDF_USE_INERTIA_FROM_FILE
        return self.p.loadURDF(str(file or self.file), at, useFixedBase=base, flags=flags)

    def infos(self, robot):
        return [self.p.getJointInfo(robot, n) for n in range(self.p.getNumJoints(robot))]

    def numbers(self, robot):
        """Return the numbers of joints, and of links, by name."""
        infos = self.infos(robot)
        root = self.p.getBodyInfo(robot)[0].decode()
        return {i[1].decode(): i[0] for i in infos}, {root: -1} | {
            i[12].decode(): i[0] for i in infos
        }

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        robot = self.load()
        hinge = self.numbers(robot)[0]["hinge"]
        self.p.resetJointState(robot, hinge, at, velocity)
        self.p.setJointMotorControl2(robot, hinge, self.p.VELOCITY_CONTROL, force=0)
        for _ in range(round(seconds / STEP)):
            self.p.setJointMotorControl2(robot, hinge, self.p.TORQUE_CONTROL, force=torque)
            self.p.stepSimulation()
        return self.p.getJointState(robot, hinge)[:2]

    def mass(self, link):
        robot = self.load()
        return self.p.getDynamicsInfo(robot, self.numbers(robot)[1][link])[0]

    def upper(self):
        robot = self.load()
        low, high = self.infos(robot)[self.numbers(robot)[0]["hinge"]][8:10]
        return high if low <= high else math.inf

    def links(self):
        return ", ".join(self.numbers(self.load())[1])

    def joint_type(self):
        robot = self.load()
        kinds = {
            self.p.JOINT_REVOLUTE: "turns",
            self.p.JOINT_PRISMATIC: "slides",
            self.p.JOINT_FIXED: "fixed",
        }
        return kinds[self.infos(robot)[self.numbers(robot)[0]["hinge"]][2]]

    def follower(self, position):
        robot = self.load()
        joints = self.numbers(robot)[0]
        self.p.resetJointState(robot, joints["hinge"], position)
        return self.p.getJointState(robot, joints["follower"])[0]

    def reaction(self):
        robot = self.load()
        mount = self.numbers(robot)[0]["mount"]
        self.p.enableJointForceTorqueSensor(robot, mount)
        self.p.stepSimulation()
        return self.p.getJointState(robot, mount)[2][2]

    def top(self, x=0.0, y=0.0):
        self.load()
        ((body, _, share, *_),) = self.p.rayTestBatch([(x, y, TOP)], [(x, y, -TOP)])
        return None if body < 0 else TOP - share * 2 * TOP

    def extent(self):
        low, high = self.p.getAABB(self.load(), -1)
        return high[1] - low[1]

    def fall(self, height, seconds, velocity=0.0):
        floor = self.file.with_name("floor.urdf")
        floor.write_text(FLOOR)
        self.load(floor)
        thing, rows = self.load(at=(0, 0, height), base=False), []
        if velocity:
            self.p.resetBaseVelocity(thing, (velocity, 0, 0), (0, velocity / height, 0))
        for _ in range(round(seconds / STEP)):
            self.p.stepSimulation()
            rows.append(self.p.getBasePositionAndOrientation(thing)[0])
        return rows

    def pixel(self):
        self.load()
        view, projection = (matrix.T.ravel().tolist() for matrix in EYE)
        lamp = {
            "lightAmbientCoeff": 1,
            "lightDiffuseCoeff": 0,
            "lightSpecularCoeff": 0,
            "shadow": 0,
        }
        image = self.p.getCameraImage(
            PIXELS, PIXELS, view, projection, renderer=self.p.ER_TINY_RENDERER, **lamp
        )
        if np.reshape(image[4], (PIXELS, PIXELS))[4, 4] < 0:
            return None
        return np.reshape(image[2], (PIXELS, PIXELS, 4))[4, 4, :3].tolist()


class MuJoCo(Reader):
    """MuJoCo by itself."""

    package = "mujoco"

    def __init__(self, file):
        import mujoco

        super().__init__(file)
        self.m = mujoco

    def load(self, spec=None):
        spec = spec or self.m.MjSpec.from_file(str(self.file))
        spec.option.timestep, spec.option.gravity = STEP, (0, 0, -G)
        model = spec.compile()
        return model, self.m.MjData(model)

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        model, data = self.load()
        hinge = model.joint("hinge")
        data.qpos[hinge.qposadr], data.qvel[hinge.dofadr] = at, velocity
        for _ in range(round(seconds / STEP)):
            data.qfrc_applied[hinge.dofadr] = torque
            self.m.mj_step(model, data)
        return data.qpos[hinge.qposadr[0]], data.qvel[hinge.dofadr[0]]

    def mass(self, link):
        return self.load()[0].body(link).mass[0]

    def upper(self):
        joint = self.load()[0].joint("hinge")
        return joint.range[1] if joint.limited[0] else math.inf

    def links(self):
        model, _ = self.load()
        return ", ".join(model.body(n).name for n in range(1, model.nbody))

    def joint_type(self):
        model, _ = self.load()
        kinds = {self.m.mjtJoint.mjJNT_HINGE: "turns", self.m.mjtJoint.mjJNT_SLIDE: "slides"}
        return kinds[self.m.mjtJoint(model.joint("hinge").type[0])]

    def follower(self, position):
        model, data = self.load()
        data.qpos[model.joint("hinge").qposadr] = position
        self.m.mj_forward(model, data)
        return data.qpos[model.joint("follower").qposadr[0]]

    def reaction(self):
        spec = self.m.MjSpec.from_file(str(self.file))
        spec.compiler.fusestatic = False
        spec.body("tool").add_site(name="wrist")
        spec.add_sensor(
            type=self.m.mjtSensor.mjSENS_FORCE, objtype=self.m.mjtObj.mjOBJ_SITE, objname="wrist"
        )
        model, data = self.load(spec)
        self.m.mj_step(model, data)
        return data.sensordata[2]

    def top(self, x=0.0, y=0.0):
        model, data = self.load()
        self.m.mj_forward(model, data)
        hit = np.zeros(1, dtype=np.int32)
        share = self.m.mj_ray(model, data, [x, y, TOP], [0, 0, -1], None, 1, -1, hit)
        return None if share < 0 else TOP - share

    def extent(self):
        model, data = self.load()
        self.m.mj_forward(model, data)
        turn = data.geom_xmat[0].reshape(3, 3)
        return 2 * (np.abs(turn) @ model.geom_aabb[0, 3:])[1]

    def fall(self, height, seconds, velocity=0.0):
        world = self.m.MjSpec()
        place = self.m.MjSpec.from_string(FLOOR)
        world.attach(place, prefix="floor/", frame=world.worldbody.add_frame())
        thing = self.m.MjSpec.from_file(str(self.file))
        thing.worldbody.bodies[0].add_freejoint()
        world.attach(thing, prefix="thing/", frame=world.worldbody.add_frame(pos=[0, 0, height]))
        (model, data), rows = self.load(world), []
        if velocity:
            data.qvel[0], data.qvel[4] = velocity, velocity / height
        for _ in range(round(seconds / STEP)):
            self.m.mj_step(model, data)
            rows.append(data.qpos[:3].tolist())
        return rows

    def pixel(self):
        """Return the colour that is set: images need OpenGL."""
        model, _ = self.load()
        shown = model.geom_rgba[model.geom_group < SHOWN_GROUPS]
        return [round(255 * part) for part in shown[0, :3].tolist()] if len(shown) else None


class Pinocchio(Reader):
    """Pinocchio, with coal for meshes; it simulates no contact."""

    package = "pin"

    def __init__(self, file):
        import pinocchio

        super().__init__(file)
        self.pin = pinocchio

    def load(self):
        model = self.pin.buildModelFromUrdf(str(self.file))
        return model, model.createData()

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        model, data = self.load()
        hinge = model.joints[model.getJointId("hinge")]
        v, push = np.zeros(model.nv), np.zeros(model.nv)
        v[hinge.idx_v], push[hinge.idx_v] = velocity, torque
        start = np.zeros(model.nv)
        start[hinge.idx_v] = at
        q = self.pin.integrate(model, self.pin.neutral(model), start)
        for _ in range(round(seconds / STEP)):
            v = v + STEP * self.pin.aba(model, data, q, v, push)
            q = self.pin.integrate(model, q, STEP * v)
            at += STEP * v[hinge.idx_v]
        return at, v[hinge.idx_v]

    def mass(self, link):
        model, _ = self.load()
        return model.inertias[model.frames[model.getFrameId(link)].parentJoint].mass

    def upper(self):
        model, _ = self.load()
        hinge = model.joints[model.getJointId("hinge")]
        return model.upperPositionLimit[hinge.idx_q] if hinge.nq == 1 else math.inf

    def links(self):
        model, _ = self.load()
        return ", ".join(model.names[1:])

    def joint_type(self):
        model, _ = self.load()
        name = model.joints[model.getJointId("hinge")].shortname()
        return "turns" if name.startswith("JointModelR") else "slides"

    def follower(self, position):
        model, _ = self.load()
        q = self.pin.neutral(model)
        q[model.joints[model.getJointId("hinge")].idx_q] = position
        return q[model.joints[model.getJointId("follower")].idx_q]

    def reaction(self):
        model, data = self.load()
        self.pin.rnea(model, data, self.pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv))
        return data.f[model.getJointId("hinge")].linear[2]

    def _shapes(self, kind):
        model, _ = self.load()
        return self.pin.buildGeomFromUrdf(
            model, str(self.file), kind, str(self.file.parent)
        ).geometryObjects

    def _box(self):
        (shape,) = self._shapes(self.pin.GeometryType.COLLISION)
        shape.geometry.computeLocalAABB()
        return shape.geometry.aabb_local

    def top(self, x=0.0, y=0.0):
        return self._box().max_[2]

    def extent(self):
        return self._box().height()

    def pixel(self):
        shapes = list(self._shapes(self.pin.GeometryType.VISUAL))
        return [round(255 * part) for part in shapes[0].meshColor[:3]] if shapes else None


class Stepbus(Reader):
    """The plant of stepbus with an engine."""

    package, engine = "stepbus", ""

    def load(self, text=None, keys="fixed_base: true", world="", **more):
        bodies = {**more, "thing": Row(text or self.file.read_text(), keys)}
        self.plant = make(self.file.parent, self.engine, bodies, world)
        return self.plant

    def notes(self):
        return [text for _, text in self.plant.physics.notes]

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        plant = self.load()
        plant.physics.teleport(plant.physics.joints["hinge"], at, velocity)
        command(plant, "torque", *(torque if name == "hinge" else 0.0 for name in plant.names))
        return state(advance(plant, round(seconds / STEP)), "hinge")

    def mass(self, link):
        physics = self.load().physics
        return physics.engine.mass(physics.links[link])

    def upper(self):
        return self.load().physics.joints["hinge"].upper

    def links(self):
        return ", ".join(self.load().physics.links)

    def joint_type(self):
        kind = self.load().physics.joints["hinge"].type
        return "slides" if kind == "prismatic" else "turns"

    def follower(self, position):
        physics = self.load().physics
        physics.teleport(physics.joints["hinge"], position, 0.0)
        return state(self.plant, "follower")[0]

    def reaction(self):
        plant = self.load(world="wrenches: {ft: {joint: mount}}")
        return sensed(plant, "Wrench/1").sense(advance(plant, 1).t_ns).force[2]

    def top(self, x=0.0, y=0.0):
        (share,) = self.load().physics.engine.cast(
            np.array([[x, y, TOP]]), np.array([[x, y, -TOP]])
        )
        return None if math.isinf(share) else TOP - share * 2 * TOP

    def extent(self):
        low, high = self.load().physics.engine.box((0, BASE))
        return high[1] - low[1]

    def fall(self, height, seconds, velocity=0.0):
        keys = f"position: [0, 0, {height}]"
        plant = self.load(keys=keys, ground=fixed(FLOOR))
        engine, rows = plant.physics.engine, []
        if velocity:
            place = (0.0, 0.0, height), (0.0, 0.0, 0.0, 1.0)
            engine.put(1, place, (velocity, 0.0, 0.0), (0.0, velocity / height, 0.0))
        for _ in range(round(seconds / STEP)):
            advance(plant, 1)
            rows.append(engine.centre(1)[0])
        return rows

    def pixel(self):
        colours, depth = self.load().physics.engine.image((PIXELS, PIXELS), *EYE, FLAT)
        return colours[4, 4].tolist() if depth[4, 4] < 1.0 else None


class StepbusWithBullet(Stepbus):
    engine = "pybullet"


class StepbusWithMuJoCo(Stepbus):
    engine = "mujoco"


READERS = {
    "pybullet": Bullet,
    "mujoco": MuJoCo,
    "pinocchio": Pinocchio,
    "stepbus_pybullet": StepbusWithBullet,
    "stepbus_mujoco": StepbusWithMuJoCo,
}
