"""What participants published in the recording, kept until they have published it again."""

from collections import deque
from collections.abc import Iterable

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.outputs.recorded import Recorded
from stepbus_orchestrator.scenario import ParticipantSpec

Ports = dict[str, bytes]
"""Port → the bytes of its message, or of its bulk content."""


class Expected:
    """The outputs of all participants below a step, read once and taken twice.

    Once as inputs of others, ahead; and once more to compare.
    """

    def __init__(self, recording: Recording, specs: Iterable[ParticipantSpec], at: int) -> None:
        self._at = at
        self._recorded = {spec.name: Recorded(recording, spec) for spec in specs}
        self._ahead: dict[str, deque[tuple[int, Ports]]] = {
            name: deque() for name in self._recorded
        }

    def below(self, name: str, step: int) -> Iterable[tuple[int, Ports]]:
        """Yield the next outputs of a participant, those of steps below `step` and the end."""
        recorded = self._recorded[name]
        while recorded.step < min(step, self._at):
            found = recorded.step, recorded.take()
            self._ahead[name].append(found)
            yield found

    def take(self, name: str, step: int) -> Ports:
        """Return the outputs of a step, in the order of steps, and forget them."""
        ahead = self._ahead[name]
        while ahead and ahead[0][0] < step:
            ahead.popleft()
        return ahead.popleft()[1] if ahead and ahead[0][0] == step else {}
