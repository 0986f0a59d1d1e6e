"""Readers of robots, each by itself and as stepbus uses it: what they make of one file.

A probe is a method that builds a world of the file, measures, and returns a number or a word; None,
if there is nothing to measure. A reader that lacks a probe leaves that cell of the page empty.
"""

import math
from importlib import import_module

import numpy as np

from stepbus_plant.engine import Light
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
    """Probes that follow from others. file: the robot; package, module: what must be installed."""

    package = module = ""

    def __init__(self, file):
        self.file = file

    def position(self, **given):
        """Return the position of the joint `hinge` after a push [rad or m]."""
        return self.push(**given)[0]

    def velocity(self, **given):
        return self.push(**given)[1]

    def acceleration(self, torque=0.0):
        return self.push(torque, seconds=STEP)[1] / STEP

    def reading(self):
        """Return what the sensor of the joint's position gives after one step of 1 N·m [rad]."""
        return self.push(1.0, seconds=STEP)[0]

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
        grey = "white" if min(found) > 150 else "grey" if min(found) else "black"
        bright = [
            name for name, part in zip(("red", "green", "blue"), found, strict=True) if part > 100
        ]
        return bright[0] if len(bright) == 1 else grey


class Bullet(Reader):
    """PyBullet by itself, with the inertias of the file, which it otherwise replaces."""

    package = module = "pybullet"

    def __init__(self, file):
        super().__init__(file)
        self.p = import_module("pybullet_utils.bullet_client").BulletClient()
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

    def freedom(self):
        """Return the degrees of freedom of the joints."""
        kinds = {self.p.JOINT_FIXED: 0, self.p.JOINT_SPHERICAL: 3, self.p.JOINT_PLANAR: 3}
        return sum(kinds.get(info[2], 1) for info in self.infos(self.load()))

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

    def fall(self, height, seconds, velocity=0.0, floor=""):
        ground = self.file.with_name("floor.urdf")
        ground.write_text(FLOOR.replace("</link>", f"{floor}</link>"))
        self.load(ground)
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

    package = module = "mujoco"

    def __init__(self, file):
        super().__init__(file)
        self.m = import_module("mujoco")

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

    def reading(self):
        spec, kind = self.m.MjSpec.from_file(str(self.file)), self.m.mjtSensor.mjSENS_JOINTPOS
        spec.add_sensor(type=kind, objtype=self.m.mjtObj.mjOBJ_JOINT, objname="hinge")
        model, data = self.load(spec)
        data.qfrc_applied[:] = 1.0
        self.m.mj_step(model, data)
        return data.sensordata[0]

    def mass(self, link):
        return self.load()[0].body(link).mass[0] if link in self.links().split(", ") else "fused"

    def upper(self):
        joint = self.load()[0].joint("hinge")
        return joint.range[1] if joint.limited[0] else math.inf

    def links(self):
        model, _ = self.load()
        return ", ".join(model.body(n).name for n in range(1, model.nbody))

    def freedom(self):
        return self.load()[0].nv

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

    def fall(self, height, seconds, velocity=0.0, floor=""):
        world = self.m.MjSpec()
        place = self.m.MjSpec.from_string(FLOOR.replace("</link>", f"{floor}</link>"))
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

    package, module = "pin", "pinocchio"

    def __init__(self, file):
        super().__init__(file)
        self.pin = import_module("pinocchio")

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
        kind = self.pin.FrameType.BODY
        return ", ".join(frame.name for frame in model.frames if frame.type == kind)

    def freedom(self):
        return self.load()[0].nv

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
        found = self.pin.buildGeomFromUrdf(
            model, str(self.file), kind, package_dirs=[str(self.file.parent)]
        )
        return found.geometryObjects

    def top(self, x=0.0, y=0.0):
        """Return the top of the box around the shape: coal has no rays."""
        shapes = self._shapes(self.pin.GeometryType.COLLISION)
        for shape in shapes:
            shape.geometry.computeLocalAABB()
        return max((shape.geometry.aabb_local.max_[2] for shape in shapes), default=None)

    def pixel(self):
        shapes = list(self._shapes(self.pin.GeometryType.VISUAL))
        return [round(255 * part) for part in shapes[0].meshColor[:3]] if shapes else None


class Stepbus(Reader):
    """The plant of stepbus with an engine."""

    package = "stepbus"

    def load(self, keys="fixed_base: true", world="", **more):
        bodies = {**more, "thing": Row(self.file.read_text(), keys)}
        self.plant = make(self.file.parent, self.module, bodies, world)
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

    def freedom(self):
        return len(self.load().names)

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

    def fall(self, height, seconds, velocity=0.0, floor=""):
        ground = fixed(FLOOR.replace("</link>", f"{floor}</link>"))
        plant = self.load(keys=f"position: [0, 0, {height}]", ground=ground)
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
    module = "pybullet"


class StepbusWithMuJoCo(Stepbus):
    module = "mujoco"


READERS = {
    "pybullet": Bullet,
    "mujoco": MuJoCo,
    "pinocchio": Pinocchio,
    "stepbus_pybullet": StepbusWithBullet,
    "stepbus_mujoco": StepbusWithMuJoCo,
}
