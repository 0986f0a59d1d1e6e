"""The ports of the mission, found by their types."""

from stepbus_participant import Ports


class PortNames:
    """Names of the ports; summary may be the same as events. Problems are added to `ports`."""

    def __init__(self, ports: Ports) -> None:
        self.events, self.summary = ports.event_outputs()
        ports.outputs_are("Goal/1", "Event/1", "CameraTrigger/1")
        self.poses, self.planogram = ports.input_beside("Poses/1", "planogram")
        self.odometry, self.pose = ports.input_beside("BaseState/1", "pose")
        self.detections = ports.input_of("Detections/1")
        self.gripper = ports.input_of("GripperState/1")
        self.status = ports.input_of("GoalStatus/1")
        self.contacts = ports.optional_input_of("Contacts/1")
        self.stop = ports.optional_input_of("EmergencyStop/1")
        self.imu = ports.optional_input_of("Imu/1")
        self.camera = ports.optional_output_of("CameraTrigger/1")
        self.goal = ports.output_of("Goal/1")
