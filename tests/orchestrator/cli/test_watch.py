"""`stepbus run --watch` runs again with each change, and shows it in a page that keeps its view."""

import queue
import re
import signal
import subprocess
import sys
import threading

import pytest
from support.browser import needs_chromium, opened
from support.paths import CHECKOUT

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.errors import ExitCode

LONGEST_S = 60.0
QUICK = ("--set", "duration=100ms")


class Watching:
    """A watch of the starter, and what it prints."""

    def __init__(self, folder, *options):
        self.folder, self.lines, self.said = folder, queue.Queue(), ""
        write_starter(folder, "python")
        command = [sys.executable, "-m", "stepbus_orchestrator.cli", "run", "scenario.yaml"]
        self.process = subprocess.Popen(
            [*command, "--watch", *options],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.put(line)

    def until(self, text):
        """Return the line with this text; what comes before it is kept in `said`."""
        while text not in (line := self.lines.get(timeout=LONGEST_S)):
            self.said += line
        self.said += line
        return line

    def end(self):
        """End it as Ctrl-C does, and return its exit code."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(LONGEST_S)
        self._reader.join(LONGEST_S)
        self.process.stdout.close()
        return code

    def edit(self, name, old, new):
        """Change a file as an editor does: by another one in its place."""
        text = (self.folder / name).read_text()
        assert old in text
        (self.folder / "part").write_text(text.replace(old, new))
        (self.folder / "part").replace(self.folder / name)


@pytest.fixture
def watching(tmp_path):
    """Return a function that starts a watch, which is ended with the test."""
    started = []

    def start(*options):
        started.append(Watching(tmp_path / "my_arm", *options))
        return started[-1]

    yield start
    for one in started:
        one.end()


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("host", [(), ("--in-process",)])
def test_each_change_is_a_run_that_is_compared_with_the_one_before(watching, host):
    one = watching(*QUICK, "--no-report", *host)
    one.until("runs/my_arm-watch/1/run.mcap")
    one.edit("controller.py", "kp * error", "2 * kp * error")
    assert "controller.py" in one.until("changed: ")
    line = one.until(" → ")
    assert "diverges from the run before at step 1, t = 0.005 s: controller/command: " in line
    one.edit("scenario.yaml", "step: 5ms", "stepp: 5ms")
    one.until("unknown key 'stepp'")
    one.edit("scenario.yaml", "stepp: 5ms", "step: 5ms")
    one.until("same messages as the run before")
    assert one.end() == 0
    assert sorted(path.name for path in (one.folder / "runs/my_arm-watch").iterdir()) == [
        "1",
        "2",
        "3",
    ]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_run_in_progress_is_ended_and_started_anew(watching):
    one = watching("--set", "duration=1h", "--real-time", "--out", "here")
    while not (one.folder / "here/1/.live.json").exists():
        assert one.process.poll() is None
        threading.Event().wait(0.1)
    (one.folder / "helper.py").write_text("")
    one.until("changed: helper.py; run here/2")
    one.process.terminate()
    assert one.process.wait(LONGEST_S) == 130


@pytest.mark.slow
@pytest.mark.timeout(2 * LONGEST_S)
def test_a_watch_ends_with_its_reader(tmp_path):
    watch = f"{sys.executable} -m stepbus_orchestrator.cli run two_link --watch --no-report"
    command = f"{watch} --set duration=10ms | head -1"
    subprocess.run(command, shell=True, cwd=tmp_path, timeout=LONGEST_S, check=True)


@pytest.mark.parametrize("option", ["--json", "--view"])
def test_what_has_one_result_has_no_watch(watching, option):
    one = watching(option)
    assert one.process.wait(LONGEST_S) == 2
    one.until(f"{option} cannot be combined with --watch")


def test_a_watch_that_cannot_write_is_one_sentence(tmp_path, capsys):
    (tmp_path / "taken").touch()
    out = str(tmp_path / "taken" / "runs")
    assert main(["run", "two_link", "--watch", "--out", out]) == ExitCode.RECORDING
    assert "cannot create a folder in" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(400)
@needs_chromium
def test_the_page_shows_the_next_run_as_it_showed_this_one(watching):
    # Beside the files that are watched.
    one = watching(*QUICK, "--out", "out")
    one.until("page ")
    with opened((one.folder / "out/watch.html").as_uri()) as shown:
        frame = shown.page.frame_locator("iframe")
        frame.locator("#from").fill("0.02")
        frame.locator("#from").dispatch_event("change")
        frame.locator("details.cell > summary").first.click()
        one.edit("controller.py", "kp * error", "2 * kp * error")
        shown.page.locator("iframe[data-source^='2/']").wait_for()
        shown.page.wait_for_function("document.querySelectorAll('iframe').length === 1")
        assert frame.locator("#from").input_value() == "0.02"
        assert frame.locator("details.cell[open]").count() == 1
        shown.page.get_by_text("RMSE").wait_for()
        assert (shown.errors, shown.strangers) == ([], [])
    one.until(" → ")
    page = (CHECKOUT / "docs/guide/running/watch.md").read_text()
    listing = re.search(r"--watch\n…\n(.*?)```", page, re.DOTALL)[1]
    listing = listing.replace("runs/my_arm-watch", "out")
    assert not (one.folder / "out/3").exists()
    numbers = re.escape(re.sub(r"\d[\d.]*", "#", listing)).replace("…\\\n", ".*")
    assert re.search(numbers, re.sub(r"\d[\d.]*", "#", one.said), re.DOTALL)
