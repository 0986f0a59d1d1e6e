"""The self-test's tester: commands each joint of a plant in turn, by a plan known beforehand."""

from stepbus_selftest.tester import TestedJoint, Tester, Trial, make_plan, modes_of, read_joints

__all__ = ["TestedJoint", "Tester", "Trial", "make_plan", "modes_of", "read_joints"]
