"""Who keeps the ports of a run busy, seen from outside the processes."""

import os
import socket
import subprocess
import sys

import pytest

from stepbus_orchestrator.processes.port_users import PortUsers

INTRUDER = """
import os, pwd, socket, sys, time
os.setuid(pwd.getpwnam("nobody").pw_uid)
kept = socket.socket()
kept.connect(("127.0.0.1", int(sys.argv[1])))
print("connected", flush=True)
time.sleep(60)
"""

TAKER = """
import os, pwd, socket, sys, time
os.setuid(pwd.getpwnam("nobody").pw_uid)
family = getattr(socket, sys.argv[1])
server = socket.socket(family)
server.bind((sys.argv[2], 0))
server.listen()
print(server.getsockname()[1], flush=True)
time.sleep(60)
"""


@pytest.fixture
def listening():
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(64)
        yield server.getsockname()[1]


def seen(*ports):
    users = PortUsers(ports)
    assert users.look() == ""
    return users.seen()


def test_a_port_that_nobody_else_uses_is_nobody_elses(listening):
    with socket.create_connection(("127.0.0.1", listening)):
        assert seen(listening) == ""
    assert seen() == ""


def test_connections_that_wait_are_counted(listening):
    clients = [socket.create_connection(("127.0.0.1", listening)) for _ in range(12)]
    assert seen(listening) == "12 connections to a TCP port of the run wait to be accepted"
    for client in clients:
        client.close()


def test_the_port_of_a_process_that_has_ended_is_anothers(listening):
    words = f"another process uses TCP port {listening} of the run"
    assert PortUsers([listening]).seen([listening]) == words
    assert PortUsers([listening]).seen([listening + 1]) == ""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_another_user_is_named_and_remembered(listening):
    stranger = subprocess.Popen(
        [sys.executable, "-S", "-c", INTRUDER, str(listening)], stdout=subprocess.PIPE
    )
    users = PortUsers([listening])
    try:
        assert stranger.stdout.readline() == b"connected\n"
        assert users.look() == ""
        assert seen(listening + 1) == ""
    finally:
        stranger.kill()
        stranger.communicate()
    assert users.seen() == "user nobody connects to the TCP ports of the run"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
@pytest.mark.parametrize(("family", "host"), [("AF_INET", "127.0.0.1"), ("AF_INET6", "::")])
def test_another_user_on_a_port_is_named(family, host):
    stranger = subprocess.Popen(
        [sys.executable, "-S", "-c", TAKER, family, host], stdout=subprocess.PIPE
    )
    try:
        port = int(stranger.stdout.readline())
        assert PortUsers([port]).look() == f"user nobody uses TCP port {port} of the run"
        assert PortUsers([port + 1]).look() == ""
    finally:
        stranger.kill()
        stranger.communicate()
