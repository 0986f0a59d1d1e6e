"""What arrives wakes the run's thread as seldom as it can, and never too late."""

from queue import SimpleQueue

from stepbus_orchestrator.run.bus import Inbox


class Case:
    """An inbox with three participants, and what was taken from it in order."""

    def __init__(self):
        self.queue = SimpleQueue()
        self.inbox = Inbox(self.queue)
        self.taken = []
        self.sinks = {name: self.inbox.into_from(name, self.taken.append) for name in "abc"}
        self.urgent = self.inbox.into(self.taken.append)

    @property
    def is_awake(self):
        return not self.queue.empty()


def test_the_last_of_those_awaited_wakes_the_thread():
    case = Case()
    case.inbox.wake_for("ab")
    case.sinks["a"]("a0")
    case.sinks["c"]("c0")
    assert not case.is_awake
    case.sinks["b"]("b0")
    assert case.is_awake
    case.inbox.receive(0.0)
    assert case.taken == ["a0", "c0", "b0"]
    case.sinks["c"]("c1")
    assert case.is_awake


def test_what_came_before_something_urgent_is_taken_before_it():
    case = Case()
    case.inbox.wake_for("ab")
    case.sinks["a"]("a0")
    case.urgent("fault of a")
    case.inbox.receive(0.0)
    assert case.taken == ["a0", "fault of a"]


def test_what_wakes_nobody_is_taken_when_the_wait_is_over():
    case = Case()
    case.inbox.wake_for("ab")
    case.sinks["a"]("a0")
    case.inbox.receive(0.001)
    assert case.taken == ["a0"]


def test_what_arrived_before_the_others_were_awaited_is_not_waited_for():
    case = Case()
    case.inbox.wake_for("ab")
    case.sinks["a"]("a0")
    # As in a turn: the run waits for others now, and `a` will send nothing more.
    case.inbox.wake_for("a")
    case.inbox.receive(60.0)
    assert case.taken == ["a0"]
