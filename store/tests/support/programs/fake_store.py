"""The store of `support.services.mission_store` as a participant; whoever copies it fills in the folder of the tests."""

import sys

sys.path.insert(0, "TESTS/../../tests")
sys.path.insert(0, "TESTS")

from support.services.mission_store import FakeStore, shelf_a

from stepbus import Participant
from stepbus_schemas import Description, Goal


class Store(Participant):
    """Plant, perception and controller in one."""

    def __init__(self, config):
        super().__init__(config)
        faults = config.params["faults"]
        goods = shelf_a(("cola", 2), ("cola", 3), ("water", 4))
        self.store = FakeStore(goods, **faults)

    def describe(self):
        return {
            **dict.fromkeys(self.config.outputs, Description()),
            "poses": self.store.description(),
        }

    def output(self, step):
        store = self.store
        messages = {
            "poses": store.poses(),
            "odometry": store.odometry(),
            "gripper": store.gripper(),
        }
        if store.news and (status := store.news.pop(0)) is not None:
            messages["goal_status"] = status
        if step.index % 5 == 0 and (found := store.detections()) is not None:
            messages["detections"] = found
        return messages

    def update(self, step):
        if step.is_new("goal"):
            self.store.carry_out(step.read("goal", Goal), "")
