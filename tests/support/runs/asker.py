"""Calls a run from a thread of its own while it is paused."""

import threading

from stepbus_orchestrator.run.reports import Observer
from stepbus_schemas import WiringError


class Asker(Observer):
    """Asks once, from a thread of its own, when the run has come to its pause."""

    def __init__(self, pace, ask):
        self.pace, self.ask, self.thread = pace, ask, None
        self.answers = []

    def progress(self, progress):
        if progress.phase == "paused" and self.thread is None:
            self.thread = threading.Thread(target=self.work)
            self.thread.start()

    def work(self):
        try:
            for question in self.ask:
                try:
                    self.answers.append(question())
                except WiringError as exc:
                    self.answers.append(str(exc))
        finally:
            self.pace.resume()
