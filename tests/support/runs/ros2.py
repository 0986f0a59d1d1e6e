"""What rosbags reads of an export for ROS 2, and forward kinematics to compare it with."""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from rosbags.highlevel import AnyReader

from stepbus_orchestrator.cli.entry import main

TF = "tf2_msgs/msg/TFMessage"


@dataclass
class Bag:
    """What rosbags reads. tf: time [ns] → frame → its parent, and its pose in it."""

    tf: dict = field(default_factory=dict)
    still: dict = field(default_factory=dict)
    texts: dict = field(default_factory=dict)
    frames: dict = field(default_factory=dict)
    joints: dict = field(default_factory=dict)

    def in_map(self):
        """Yield each time and frame → its pose in `map`, of all that are known by then."""
        newest = dict(self.still)
        for t_ns, placed in self.tf.items():
            newest |= placed
            yield t_ns, {name: chained(newest, name) for name in newest}


def chained(newest, name):
    pose = pin.SE3.Identity()
    while name != "map":
        name, step = newest[name]
        pose = step * pose
    return pose


def read(target):
    bag = Bag()
    with AnyReader([target]) as reader:
        for connection, t_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.msgtype == TF:
                rows = {row.child_frame_id: placed(row) for row in message.transforms}
                assert len(rows) == len(message.transforms)
                if connection.topic == "/tf":
                    bag.tf[t_ns] = rows
                else:
                    bag.still = rows
            elif connection.msgtype == "std_msgs/msg/String":
                bag.texts[connection.topic] = message.data
            elif hasattr(message, "header"):
                child = getattr(message, "child_frame_id", "")
                bag.frames[connection.topic] = (message.header.frame_id, child)
            if connection.topic in {"/plant/joint_state", "/plant/gripper"}:
                found = dict(zip(message.name, message.position, strict=True))
                bag.joints.setdefault(t_ns, {}).update(found)
    return bag


def placed(row):
    t, q = row.transform.translation, row.transform.rotation
    rotation = pin.Quaternion(q.w, q.x, q.y, q.z).toRotationMatrix()
    return row.header.frame_id, pin.SE3(rotation, np.array([t.x, t.y, t.z]))


def kinematics(urdf, positions):
    """Return link → its pose in the root, by Pinocchio; joints that are not given rest at 0."""
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    q = pin.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    links = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    return {frame.name: data.oMf[model.getFrameId(frame.name)] for frame in links}


def export(recording, target):
    assert main(["export", str(recording), "--ros2", str(target)]) == 0
    return read(target)


def agree(one, other, within):
    return np.allclose(one.homogeneous, other.homogeneous, atol=within)
