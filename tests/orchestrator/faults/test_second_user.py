"""Another user of the same machine: on the TCP ports of a run, at its pages and its processes."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import psutil
import pytest
from support.runs.second_user import needs_second_user, second_user
from support.surroundings import comes_true, listening, warm_ones

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]

AWAIT = """
first = int(sys.argv[1])
print("ready", flush=True)
while f"0100007F:{first:04X} 00000000:0000 0A" not in open("/proc/net/tcp").read():
    time.sleep(0.001)
"""
"""Waits until the orchestrator of a run listens on its first port."""

SQUAT = (
    AWAIT
    + """
held = []
for port in range(first + 1, first + 4):
    server = socket.create_server(("127.0.0.1", port))
    held.append(server)
time.sleep(1000)
"""
)
BABBLE = (
    AWAIT
    + """
def babble():
    while True:
        for port in range(first, first + 4):
            try:
                with socket.create_connection(("127.0.0.1", port), 0.5) as link:
                    link.sendall(b"nonsense")
            except OSError:
                pass

for _ in range(4):
    threading.Thread(target=babble).start()
"""
)
HELD = """
name: held
extends: two_link
duration: 1s
participants:
"""
PARTICIPANTS = {
    "plant": "stepbus_plant:Plant",
    "controller": "stepbus_controller:Controller",
    "mission": "stepbus_mission:Mission",
}
WAITS = """
  {name}:
    exec: [sh, -c, 'until grep -q ":{port:04X} 00000000:0000 0A" /proc/net/tcp; do sleep 0.05; done;
                    exec "$0" -m stepbus_participant {cls}', {python}]
"""
"""A participant that starts when somebody listens on a port."""


def held_scenario(first, folder):
    """Write a scenario whose participants start when all of their ports are taken."""
    rows = [
        WAITS.format(name=name, cls=cls, port=first + 3, python=json.dumps(sys.executable))
        for name, cls in PARTICIPANTS.items()
    ]
    path = folder / "held.yaml"
    path.write_text(HELD + "".join(rows))
    return path


def free_ports():
    """Return the first of four ports in a row that are free, and that no connection is given."""
    first = 20_000 + 8 * (os.getpid() % 1000)
    while not all(is_free(port) for port in range(first, first + 4)):
        first += 4
    return first


def is_free(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


def run_under(attack, tmp_path, *words, scenario="two_link", is_other=True):
    """Run a scenario over TCP under an attack; returns exit code, error and result.json.

    scenario: or what writes it, given the first port and a folder.
    """
    first = free_ports()
    scenario = scenario(first, tmp_path) if callable(scenario) else scenario
    out = tmp_path / "run"
    command = [*STEPBUS, "run", scenario, "--transport", "tcp", "--set", f"bus.port={first}"]
    with second_user(attack, first, is_other=is_other) as attacker:
        assert attacker.stdout.readline() == "ready\n"
        done = subprocess.run(
            [*command, *words, "--no-report", "--out", out],
            capture_output=True, text=True, check=False, timeout=200,
        )  # fmt: skip
    return done.returncode, done.stderr, json.loads((out / "result.json").read_bytes())


@pytest.mark.parametrize(
    "is_other",
    [pytest.param(True, marks=needs_second_user), pytest.param(False, marks=pytest.mark.slow)],
)
def test_a_port_that_somebody_takes_first_is_named(tmp_path, is_other):
    code, error, result = run_under(SQUAT, tmp_path, scenario=held_scenario, is_other=is_other)
    assert (code, result["steps"]) == (3, 0)
    assert re.search("Address already in use", error)


@pytest.mark.slow
@needs_second_user
def test_nonsense_from_the_start_ends_the_start_at_worst(tmp_path):
    # Four threads that send nonsense take whatever time there is.
    patient = [f"{name}.{what}_timeout=60s" for name in PARTICIPANTS for what in ("step", "stop")]
    words = [word for item in ("duration=100ms", *patient) for word in ("--set", item)]
    code, _, result = run_under(BABBLE, tmp_path, *words)
    assert (code, result["steps"] > 0) in {(0, True), (3, False)}


def family_of(process):
    """Return the processes of a command, as long as they run."""
    parent = psutil.Process(process.pid)
    return [parent, *parent.children(recursive=True)]


SPY = """
pids, private, address = sys.argv[1].split(), sys.argv[2], sys.argv[3]
def tried(what):
    try:
        what()
    except OSError:
        return False
    return True
def connect(path):
    with socket.socket(socket.AF_UNIX) as link:
        link.connect(path)
got = [f"{name} of {pid}" for pid in pids for name in ("environ", "mem", "fd/1")
       if tried(lambda: open(f"/proc/{pid}/{name}", "rb").read(1))]
got += [name for name in ("", "/0.sock", "/plant.ticket")
        if tried(lambda: connect(private + name)) or tried(lambda: os.stat(private + name + "/."))]
page = address.rsplit("/", 2)[0] + "/"
got += [page] if tried(lambda: urllib.request.urlopen(page, timeout=60)) else []
def words_of(pid):
    try:
        return open(f"/proc/{pid}/cmdline").read()
    except (FileNotFoundError, ProcessLookupError):
        return ""
words = "".join(map(words_of, pids))
print(got, address.rsplit("/", 2)[1] in words, flush=True)
"""


OPEN = """
print(urllib.request.urlopen(sys.argv[1], timeout=60).status, flush=True)
"""


@pytest.fixture
def open_folder():
    """A folder that every user may enter, as that of a test is not."""
    with tempfile.TemporaryDirectory(prefix="stepbus-test-") as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["unix", "tcp"])
def test_another_user_gets_nothing_of_a_run_with_its_pages(open_folder, transport):
    out, temporary = open_folder / "run", open_folder / "tmp"
    temporary.mkdir()
    command = [*STEPBUS, "run", "two_link", "--transport", transport, "--real-time", "--no-report"]
    with subprocess.Popen(
        [*command, "--set", "duration=1h", "--view", "--no-open", "--out", out],
        env={**os.environ, "TMPDIR": str(temporary)}, umask=0, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        try:
            page = re.search(r"http://\S+", process.stderr.readline())[0]
            assert comes_true((out / ".live.json").exists)
            (private,) = [path for path in temporary.glob("stepbus-*") if path.name[8:12] != "view"]
            assert comes_true((private / "mission.ticket").exists)
            assert comes_true(lambda: not warm_ones(family_of(process)))
            assert listening(family_of(process)) == {"127.0.0.1"}
            with second_user(OPEN, page, is_other=False) as owner:
                assert owner.communicate()[0] == "200\n"
            pids = " ".join(str(member.pid) for member in family_of(process))
            if os.getuid() == 0:
                with second_user(SPY, pids, private, page) as spy:
                    assert spy.communicate()[0] == "[] False\n"
            # The owner's own eyes see something: the program does look.
            with second_user(SPY, process.pid, private, page, is_other=False) as spy:
                assert f"environ of {process.pid}" in spy.communicate()[0]
            assert (out / ".live.json").stat().st_mode & 0o077 == 0
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=100)
