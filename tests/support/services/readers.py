"""Readers of robots, each by itself and as stepbus uses it: what they make of one file.

A probe is a method that builds a world of the file, measures, and returns a number or a word; None,
if there is nothing to measure. A reader that lacks a probe leaves that cell of the page empty.
"""

import math
from importlib import import_module

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


def floor_of(contact):
    """Return the URDF of a floor with an element `<contact>`."""
    return FLOOR.replace("</link>", f"{contact}</link>")


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
        if min(found) == max(found):
            return "white" if min(found) > 150 else "grey" if min(found) else "black"
        return ("red", "green", "blue")[int(np.argmax(found))]


class Bullet(Reader):
    """PyBullet by itself, with the inertias of the file, which it otherwise replaces."""

    package = module = "pybullet"

    def __init__(self, file):
        super().__init__(file)
        self.p = import_module("pybullet_utils.bullet_client").BulletClient()
        self.p.setTimeStep(STEP)
        self.p.setGravity(0, 0, -G)

    def load(self, file=None, at=(0, 0, 0), *, base=True):
        """Return the number of a robot; keep those of its joints and links, by name."""
        flags = self.p.URDF_USE_INERTIA_FROM_FILE
        robot = self.p.loadURDF(str(file or self.file), at, useFixedBase=base, flags=flags)
        self.infos = [self.p.getJointInfo(robot, n) for n in range(self.p.getNumJoints(robot))]
        self.joint = {info[1].decode(): info[0] for info in self.infos}
        root = self.p.getBodyInfo(robot)[0].decode()
        self.link = {root: -1} | {info[12].decode(): info[0] for info in self.infos}
        return robot

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        robot, hinge = self.load(), self.joint["hinge"]
        self.p.resetJointState(robot, hinge, at, velocity)
        self.p.setJointMotorControl2(robot, hinge, self.p.VELOCITY_CONTROL, force=0)
        for _ in range(round(seconds / STEP)):
            self.p.setJointMotorControl2(robot, hinge, self.p.TORQUE_CONTROL, force=torque)
            self.p.stepSimulation()
        return self.p.getJointState(robot, hinge)[:2]

    def mass(self, link):
        return self.p.getDynamicsInfo(self.load(), self.link[link])[0]

    def upper(self):
        self.load()
        low, high = self.infos[self.joint["hinge"]][8:10]
        return high if low <= high else math.inf

    def links(self):
        self.load()
        return ", ".join(self.link)

    def freedom(self):
        """Return the degrees of freedom of the joints."""
        self.load()
        kinds = {self.p.JOINT_FIXED: 0, self.p.JOINT_PLANAR: 3}
        return sum(kinds.get(info[2], 1) for info in self.infos)

    def follower(self, position):
        robot = self.load()
        self.p.resetJointState(robot, self.joint["hinge"], position)
        return self.p.getJointState(robot, self.joint["follower"])[0]

    def reaction(self):
        robot, mount = self.load(), self.joint["mount"]
        self.p.enableJointForceTorqueSensor(robot, mount)
        self.p.stepSimulation()
        return self.p.getJointState(robot, mount)[2][2]

    def top(self, x=0.0, y=0.0):
        self.load()
        ((body, _, share, *_),) = self.p.rayTestBatch([(x, y, TOP)], [(x, y, -TOP)])
        return None if body < 0 else TOP - share * 2 * TOP

    def fall(self, height, seconds, velocity=0.0, floor=""):
        ground = self.file.with_name("floor.urdf")
        ground.write_text(floor_of(floor))
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
        matrices = [matrix.T.ravel().tolist() for matrix in EYE]
        lamp = {
            "lightAmbientCoeff": 1,
            "lightDiffuseCoeff": 0,
            "lightSpecularCoeff": 0,
            "shadow": 0,
        }
        image = self.p.getCameraImage(PIXELS, PIXELS, *matrices, **lamp)
        is_seen = np.reshape(image[4], (PIXELS, PIXELS))[4, 4] >= 0
        return np.reshape(image[2], (PIXELS, PIXELS, 4))[4, 4, :3].tolist() if is_seen else None


class MuJoCo(Reader):
    """MuJoCo by itself."""

    package = module = "mujoco"

    def __init__(self, file):
        super().__init__(file)
        self.m = import_module("mujoco")

    def spec(self):
        return self.m.MjSpec.from_file(str(self.file))

    def load(self, spec=None):
        """Return the model, with its links' places computed, and its data."""
        spec = spec or self.spec()
        spec.option.timestep, spec.option.gravity = STEP, (0, 0, -G)
        model = spec.compile()
        data = self.m.MjData(model)
        self.m.mj_forward(model, data)
        return model, data

    def sensed(self, spec, kind, of, name):
        """Return what a sensor gives after one step, in which joints get 1 N·m."""
        spec.add_sensor(type=kind, objtype=of, objname=name)
        model, data = self.load(spec)
        data.qfrc_applied[:] = 1.0
        self.m.mj_step(model, data)
        return data.sensordata[-1]

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        model, data = self.load()
        hinge = model.joint("hinge")
        data.qpos[hinge.qposadr], data.qvel[hinge.dofadr] = at, velocity
        for _ in range(round(seconds / STEP)):
            data.qfrc_applied[hinge.dofadr] = torque
            self.m.mj_step(model, data)
        return data.qpos[hinge.qposadr[0]], data.qvel[hinge.dofadr[0]]

    def reading(self):
        kind, of = self.m.mjtSensor.mjSENS_JOINTPOS, self.m.mjtObj.mjOBJ_JOINT
        return self.sensed(self.spec(), kind, of, "hinge")

    def reaction(self):
        spec = self.spec()
        spec.compiler.fusestatic = False
        spec.body("tool").add_site(name="wrist")
        return self.sensed(spec, self.m.mjtSensor.mjSENS_FORCE, self.m.mjtObj.mjOBJ_SITE, "wrist")

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

    def top(self, x=0.0, y=0.0):
        hit = np.zeros(1, dtype=np.int32)
        share = self.m.mj_ray(*self.load(), [x, y, TOP], [0, 0, -1], None, 1, -1, hit)
        return None if share < 0 else TOP - share

    def fall(self, height, seconds, velocity=0.0, floor=""):
        world, thing = self.m.MjSpec(), self.spec()
        frame = world.worldbody.add_frame
        world.attach(self.m.MjSpec.from_string(floor_of(floor)), prefix="floor/", frame=frame())
        thing.worldbody.bodies[0].add_freejoint()
        world.attach(thing, prefix="thing/", frame=frame(pos=[0, 0, height]))
        (model, data), rows = self.load(world), []
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
        """Return the model, and where the joint `hinge` has its position and its velocity."""
        model = self.pin.buildModelFromUrdf(str(self.file))
        hinge = model.joints[model.getJointId("hinge")] if model.existJointName("hinge") else None
        return model, hinge

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        model, hinge = self.load()
        data, q = model.createData(), self.pin.neutral(model)
        v, push = np.zeros(model.nv), np.zeros(model.nv)
        v[hinge.idx_v], push[hinge.idx_v] = velocity, torque
        for _ in range(round(seconds / STEP)):
            v = v + STEP * self.pin.aba(model, data, q, v, push)
            q = self.pin.integrate(model, q, STEP * v)
            at += STEP * v[hinge.idx_v]
        return at, v[hinge.idx_v]

    def mass(self, link):
        model, _ = self.load()
        return model.inertias[model.frames[model.getFrameId(link)].parentJoint].mass

    def upper(self):
        model, hinge = self.load()
        return model.upperPositionLimit[hinge.idx_q] if hinge.nq == 1 else math.inf

    def links(self):
        kind = self.pin.FrameType.BODY
        return ", ".join(frame.name for frame in self.load()[0].frames if frame.type == kind)

    def freedom(self):
        return self.load()[0].nv

    def follower(self, position):
        model, hinge = self.load()
        q = self.pin.neutral(model)
        q[hinge.idx_q] = position
        return q[model.joints[model.getJointId("follower")].idx_q]

    def shapes(self, kind):
        folders = {"package_dirs": [str(self.file.parent)]}
        found = self.pin.buildGeomFromUrdf(self.load()[0], str(self.file), kind, **folders)
        return found.geometryObjects

    def top(self, x=0.0, y=0.0):
        """Return the top of the box around the shape: coal has no rays."""
        shapes = [shape.geometry for shape in self.shapes(self.pin.GeometryType.COLLISION)]
        for shape in shapes:
            shape.computeLocalAABB()
        return max((shape.aabb_local.max_[2] for shape in shapes), default=None)

    def pixel(self):
        shapes = self.shapes(self.pin.GeometryType.VISUAL)
        return [round(255 * part) for part in shapes[0].meshColor[:3]] if len(shapes) else None


class Stepbus(Reader):
    """The plant of stepbus with an engine."""

    package = "stepbus"

    def load(self, keys="fixed_base: true", world="", **more):
        """Return the physics of a world with the robot."""
        bodies = {**more, "thing": Row(self.file.read_text(), keys)}
        self.plant = make(self.file.parent, self.module, bodies, world)
        return self.plant.physics

    def notes(self):
        return "\n".join(text for _, text in self.plant.physics.notes)

    def push(self, torque=0.0, velocity=0.0, at=0.0, seconds=1.0):
        physics = self.load()
        physics.teleport(physics.joints["hinge"], at, velocity)
        command(self.plant, "torque", *(torque if n == "hinge" else 0.0 for n in self.plant.names))
        return state(advance(self.plant, round(seconds / STEP)), "hinge")

    def mass(self, link):
        physics = self.load()
        return physics.engine.mass(physics.links[link])

    def upper(self):
        return self.load().joints["hinge"].upper

    def links(self):
        return ", ".join(self.load().links)

    def freedom(self):
        return len(self.load().joints)

    def follower(self, position):
        physics = self.load()
        physics.teleport(physics.joints["hinge"], position, 0.0)
        return state(self.plant, "follower")[0]

    def reaction(self):
        self.load(world="wrenches: {ft: {joint: mount}}")
        return sensed(self.plant, "Wrench/1").sense(advance(self.plant, 1).t_ns).force[2]

    def top(self, x=0.0, y=0.0):
        (share,) = self.load().engine.cast(np.array([[x, y, TOP]]), np.array([[x, y, -TOP]]))
        return None if math.isinf(share) else TOP - share * 2 * TOP

    def fall(self, height, seconds, velocity=0.0, floor=""):
        keys, ground = f"position: [0, 0, {height}]", fixed(floor_of(floor))
        engine, rows = self.load(keys, ground=ground).engine, []
        if velocity:
            engine.put(1, engine.frame((1, BASE)), (velocity, 0, 0), (0, velocity / height, 0))
        for _ in range(round(seconds / STEP)):
            advance(self.plant, 1)
            rows.append(engine.centre(1)[0])
        return rows

    def pixel(self):
        colours, depth = self.load().engine.image((PIXELS, PIXELS), *EYE, FLAT)
        return colours[4, 4].tolist() if depth[4, 4] < 1.0 else None


READERS = {
    "pybullet": Bullet,
    "mujoco": MuJoCo,
    "pinocchio": Pinocchio,
    "stepbus_pybullet": type("StepbusWithBullet", (Stepbus,), {"module": "pybullet"}),
    "stepbus_mujoco": type("StepbusWithMuJoCo", (Stepbus,), {"module": "mujoco"}),
}
