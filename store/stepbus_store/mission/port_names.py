"""The ports of the mission, found by their types."""

from dataclasses import dataclass

from stepbus_participant import Ports


@dataclass(frozen=True, kw_only=True)
class PortNames:
    """Names of the ports; summary may be the same as events."""

    poses: str
    planogram: str
    detections: str
    gripper: str
    odometry: str
    pose: str
    status: str
    contacts: str | None
    stop: str | None
    imu: str | None
    camera: str | None
    goal: str
    events: str
    summary: str


def find_ports(ports: Ports) -> PortNames:
    """Return the names of the ports; problems are added to `ports`."""
    events, summary_port = ports.event_outputs()
    ports.outputs_are("Goal/1", "Event/1", "CameraTrigger/1")
    poses, planogram = ports.input_beside("Poses/1", "planogram")
    odometry, pose = ports.input_beside("BaseState/1", "pose")
    return PortNames(
        poses=poses,
        planogram=planogram,
        detections=ports.input_of("Detections/1"),
        gripper=ports.input_of("GripperState/1"),
        odometry=odometry,
        pose=pose,
        status=ports.input_of("GoalStatus/1"),
        contacts=ports.optional_input_of("Contacts/1"),
        stop=ports.optional_input_of("EmergencyStop/1"),
        imu=ports.optional_input_of("Imu/1"),
        camera=ports.optional_output_of("CameraTrigger/1"),
        goal=ports.output_of("Goal/1"),
        events=events,
        summary=summary_port,
    )
