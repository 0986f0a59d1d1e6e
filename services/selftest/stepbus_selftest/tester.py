"""The participant that stands in for controller and mission while a plant is tested."""

from collections.abc import Mapping

from stepbus_participant import Participant, Step
from stepbus_schemas import Description, JointState, Message, RunError

from .plan import Trial, commands_at, make_plan, read_joints


class Tester(Participant):
    """Commands every joint in turn, and ends the run after the last.

    Its input is the joint state; its outputs are named as the modes they command. Parameters:
    angle [rad]; only: names of the joints to test; names: of all joints of each mode.
    """

    def describe(self) -> Mapping[str, Description]:
        """Return the names of each output; known once the plant has described them."""
        return {
            mode: Description(names=self.config.params["names"][mode])
            for mode in self.config.outputs
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take in what the plant says of its joints."""
        (self._description,) = inputs.values()
        (self._input,) = inputs
        self._plan: list[Trial] = []

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the commands of this step."""
        step_s = self.config.every * self.config.step_ns * 1e-9
        count = step.index // self.config.every
        if count == 0:
            state = step.read(self._input, JointState)
            if state.position is None:
                raise RunError(f"{self.config.name}: the plant senses no positions")
            self._joints = read_joints(self._description, state.position)
            params = self.config.params
            self._plan = make_plan(self._joints, step_s, params["angle"], params["only"])
        if not self._plan or count >= self._plan[-1].end:
            step.end("all joints have been tested")
        return dict(commands_at(count, self._plan, self._joints, step_s))
