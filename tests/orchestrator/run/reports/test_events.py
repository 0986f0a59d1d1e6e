"""Events of participants: shown in the order of the recording, and warnings counted."""

from stepbus_orchestrator.run.reports import Events, Observer
from stepbus_schemas import Event


class Watcher(Observer):
    """Keeps what it is told."""

    def __init__(self):
        self.lines = []

    def event(self, level, who, step, text):
        self.lines.append(f"{level} {who}@{step} {text}")


def test_each_line_of_a_warning_is_shown_and_counted():
    watcher = Watcher()
    events = Events(watcher)
    events.take("plant", "events", 3, Event(level="warning", text="no motor\nno effort"))
    assert watcher.lines == ["warning plant@3 no motor", "warning plant@3 no effort"]
    assert (events.count, [w.text for w in events.warnings]) == (2, ["no motor", "no effort"])


def test_a_flood_is_cut_and_counted():
    watcher = Watcher()
    events = Events(watcher)
    for step in range(200):
        events.take("plant", "events", step, Event(level="error", text=f"hot {step}"))
    assert (len(watcher.lines), len(events.warnings), events.count) == (51, 50, 200)
    assert watcher.lines[-1].endswith("plant.events are only in the recording")
