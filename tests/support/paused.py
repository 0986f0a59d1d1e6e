"""A run in a thread of its own that is paused before its first step."""

import contextlib
import threading

from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_tools.viewing.live_page import follow


class Paused:
    """A run of a scenario, in the folder `out`. result: of the run that has ended."""

    def __init__(self, out, scenario, **options):
        self.out, self.pace, self.interrupt = out, Pace(0), threading.Event()
        self.result = None
        self.thread = threading.Thread(target=self.work, args=(scenario, options))
        self.thread.start()

    def work(self, scenario, options):
        options = Options(out=self.out, extensions=[self.pace], **options)
        self.result = run(scenario, options, interrupt=self.interrupt)

    def end(self):
        self.pace.resume()
        self.thread.join()
        return self.result


@contextlib.contextmanager
def followed(paused, page):
    """Show a run on a page while this is open; then end the run."""
    over = threading.Event()
    viewer = threading.Thread(target=follow, args=(page.server, paused.out, over.is_set))
    viewer.start()
    try:
        yield
    finally:
        over.set()
        paused.interrupt.set()
        paused.end()
        viewer.join()


def calls_of(result):
    return [(call.method, *call.args) for call in recorded_calls(Recording(result.recording))]
