"""Fixtures that several test files share."""

import gc
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings
from support.browser import page  # noqa: F401  a fixture
from support.disks import small_disk  # noqa: F401  a fixture
from support.properties import DEFAULT
from support.runs.sshd import robot  # noqa: F401  a fixture
from support.surroundings import left_as_found, no_thread_is_left, nothing_is_left  # noqa: F401
from support.wan import wan  # noqa: F401  a fixture

from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

# A folder of `testpaths` is never ignored itself; what is in it is.
collect_ignore_glob = [] if find_spec("stepbus_store") else ["store/tests/*"]


def pytest_addoption(parser):
    """Add `--unit` (`make test-unit`), `--fresh-examples` (`make test-slow`) and `--engine`."""
    parser.addoption("--unit", action="store_true", help="skip tests that start a process")
    text = "property tests draw from a fresh seed, and ten times as many examples"
    parser.addoption("--fresh-examples", action="store_true", help=text)
    parser.addoption("--passed-to", metavar="FILE", help="write the names of passed tests there")
    text = "the engine of worlds that name none, in tests that start no process"
    parser.addoption("--engine", metavar="NAME", help=text)
    parser.addoption("--but", metavar="FILE", help="leave out the tests that are named there")


# The tests that pytest has rewritten are kept, also where PYTHONDONTWRITEBYTECODE is set: each of
# its processes needs 5 s for them.
sys.dont_write_bytecode = False


def pytest_configure(config):
    """Draw the same examples for the same commit, unless fresh ones are asked for."""
    settings.register_profile("fixed", derandomize=True, deadline=None)
    settings.register_profile("fresh", max_examples=10 * DEFAULT, deadline=None, print_blob=True)
    settings.load_profile("fresh" if config.getoption("--fresh-examples") else "fixed")
    if engine := config.getoption("--engine"):
        from stepbus_plant import engines  # noqa: PLC0415  others need no engine

        engines.ENGINES = (engine, *(name for name in engines.ENGINES if name != engine))


# Tests that are started in the background or with nohup ignore signals, and so would all
# processes of a test that sends them some.
for _number, _handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGTERM, signal.SIG_DFL),
):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, _handler)


def pytest_collection_modifyitems(config, items):
    """Leave out what `--but` names."""
    if (file := config.getoption("--but")) is not None:
        names = set(Path(file).read_text().splitlines())
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in names])
        items[:] = [item for item in items if item.nodeid not in names]


def pytest_terminal_summary(terminalreporter, config):
    """Name the tests that passed, for `--passed-to`; say which were not even looked at."""
    if (file := config.getoption("--passed-to")) is not None:
        names = {report.nodeid for report in terminalreporter.stats.get("passed", [])}
        Path(file).write_text("".join(f"{name}\n" for name in sorted(names)))
    if collect_ignore_glob:
        terminalreporter.write_line("skipped store/tests, which need stepbus-store: `make robots`")


def pytest_collection_finish():
    """Leave what was collected out of each later search for garbage: that takes a tenth less."""
    gc.freeze()


MOST_CLIENTS = 1024
"""Of PyBullet in one process."""


REFUSED: list[int] = []
"""An entry for each process that this test was not allowed to start."""


@pytest.fixture(scope="session", autouse=True)
def no_processes(request):
    """With `--unit`, skip a test that starts a process, at the moment it does."""
    if not request.config.getoption("--unit"):
        yield
        return

    def refuse(_self, *_args, **_kwargs):
        REFUSED.append(1)
        pytest.skip("starts a process")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess.Popen, "__init__", refuse)
        patch.setattr(subprocess.Popen, "__del__", lambda _self: None)
        yield


@pytest.fixture
def starts_a_process(request):
    """With `--unit`, skip the test, where nothing else lets it: a run says the skip is a fault."""
    if request.config.getoption("--unit"):
        pytest.skip("starts a process")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    """Skip, with `--unit`, what was refused a process: the code under test may have caught that."""
    REFUSED.clear()
    try:
        return (yield)
    except Exception:
        if REFUSED:
            pytest.skip("starts a process")
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """Show with a failed test how each of its runs ended; a gate's folder is out of reach."""
    report = yield
    folder = getattr(item, "funcargs", {}).get("tmp_path")
    if report.failed and folder is not None:
        for path in sorted(filter(Path.is_file, folder.rglob("result.json"))):
            report.sections.append((f"{path.relative_to(folder)}", path.read_text()))
    return report


@pytest.fixture(scope="session")
def two_link_recording(tmp_path_factory):
    """Return run.mcap of 0.3 s of two_link, with its run's folder around it; do not change it."""
    out = tmp_path_factory.mktemp("two_link") / "run"
    result = run(load("two_link", ["duration=300ms"]), Options(out=out))
    assert result.exit_code == 0, result.reason
    return result.recording


@pytest.fixture
def own_temp(monkeypatch):
    """Return a folder for temporary files of this test and its processes, which must stay empty.

    Its path is short: that of a Unix socket holds at most 107 bytes.
    """
    with tempfile.TemporaryDirectory(prefix="sb-") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.setenv("TMPDIR", folder)
        yield Path(folder)
        monkeypatch.undo()


def physics_clients():
    """Return the clients of PyBullet that this process has open."""
    pybullet = sys.modules.get("pybullet")
    return set() if pybullet is None else set(filter(pybullet.isConnected, range(MOST_CLIENTS)))


@pytest.fixture(autouse=True, scope="module")
def _physics_is_closed():
    """Close each physics client that the tests of a file have opened: one takes 25 MB and more."""
    before = physics_clients()
    yield
    for client in physics_clients() - before:
        sys.modules["pybullet"].disconnect(client)
    if engine := sys.modules.get("stepbus_plant.engines.pybullet"):
        engine.empty_clients.clear()
        engine.left_clients.clear()
