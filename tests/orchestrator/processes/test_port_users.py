"""Who keeps the ports of a run busy, seen from outside the processes."""

import os
import socket
import subprocess
import sys

import pytest
from support.runs.joints import write_scenario
from support.runs.kernel import Process

from stepbus_orchestrator import load
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes.activity import Activity
from stepbus_orchestrator.processes.links.port_users import crowd
from stepbus_orchestrator.run.kernel.failures import late_to_start
from stepbus_orchestrator.run.kernel.participants import ParticipantState

INTRUDER = """
import os, pwd, socket, sys, time
os.setuid(pwd.getpwnam("nobody").pw_uid)
kept = socket.socket()
kept.connect(("127.0.0.1", int(sys.argv[1])))
print("connected", flush=True)
time.sleep(60)
"""


@pytest.fixture
def listening():
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(64)
        yield server.getsockname()[1]


def test_a_port_that_nobody_else_uses_is_not_crowded(listening):
    with socket.create_connection(("127.0.0.1", listening)):
        assert crowd([listening]) == ""
    assert crowd([]) == ""


def test_connections_that_wait_are_counted(listening):
    clients = [socket.create_connection(("127.0.0.1", listening)) for _ in range(12)]
    assert crowd([listening]) == "12 connections to its TCP ports wait to be accepted"
    for client in clients:
        client.close()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_another_user_is_named(listening):
    stranger = subprocess.Popen(
        [sys.executable, "-S", "-c", INTRUDER, str(listening)], stdout=subprocess.PIPE
    )
    try:
        assert stranger.stdout.readline() == b"connected\n"
        assert crowd([listening]) == "user nobody connects to its TCP ports"
        assert crowd([listening + 1]) == ""
    finally:
        stranger.kill()
        stranger.communicate()


def test_a_participant_that_strangers_keep_from_the_bus_is_not_blamed(tmp_path):
    process = Process()
    process.activity = lambda: Activity(crowd="user eve connects to its TCP ports")
    spec = load(write_scenario(tmp_path)).participant("controller")
    failure = late_to_start(ParticipantState(spec, process))
    assert (failure.code, failure.participant) == (ExitCode.BUS, None)
    assert "has not reached the bus; user eve connects to its TCP ports" in str(failure)
