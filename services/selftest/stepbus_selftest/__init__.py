"""The self-test's tester: commands each joint of a plant in turn, by a plan known beforehand."""

from .plan import TestedJoint, Trial, make_plan, modes_of, read_joints
from .tester import Tester

__all__ = ["TestedJoint", "Tester", "Trial", "make_plan", "modes_of", "read_joints"]
