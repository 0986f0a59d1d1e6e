"""The ports of a controller of a mobile manipulator."""

from dataclasses import dataclass

from stepbus_participant import Ports


@dataclass(frozen=True, kw_only=True)
class MobilePorts:
    """Names of the ports; those that may be None are left out by some scenarios."""

    joint_state: str
    odometry: str
    gripper_state: str
    goal: str
    contacts: str | None
    plan: str | None
    arm: str
    base: str
    gripper: str
    goal_status: str
    plan_request: str | None
    status: str | None


def find_ports(ports: Ports) -> MobilePorts:
    """Return the names of the ports, found by their types; problems are added to `ports`."""
    plan = ports.optional_input_of("Plan/1")
    request = ports.optional_output_of("PlanRequest/1")
    if (plan is None) != (request is None):
        text = "a planner needs an input of type Plan/1 and an output of type PlanRequest/1"
        ports.problems.add((), f"{text}; wire both, or none of them")
    mobile_ports = MobilePorts(
        joint_state=ports.input_of("JointState/1"),
        odometry=ports.input_of("BaseState/1"),
        gripper_state=ports.input_of("GripperState/1"),
        goal=ports.input_of("Goal/1"),
        contacts=ports.optional_input_of("Contacts/1"),
        plan=plan,
        arm=ports.output_of("JointCommand/1"),
        base=ports.output_of("BaseCommand/1"),
        gripper=ports.output_of("GripperCommand/1"),
        goal_status=ports.output_of("GoalStatus/1"),
        plan_request=request,
        status=ports.optional_output_of("ControllerStatus/1"),
    )
    ports.outputs_are(
        "JointCommand/1", "BaseCommand/1", "GripperCommand/1", "GoalStatus/1", "PlanRequest/1",
        "ControllerStatus/1",
    )  # fmt: skip
    return mobile_ports
