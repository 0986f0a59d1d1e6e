"""What is refused before anything starts; hosts, addresses and scenarios that do not fit."""

import signal
from types import SimpleNamespace

import pytest

import stepbus
from stepbus_hosts.addresses import parse_address
from stepbus_hosts.agent import sentence
from stepbus_hosts.connection import RemoteProcess
from stepbus_hosts.hosts_file import read_hosts
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.replay.sources import Sources

HOSTS = "robot: {address: robot.local, user: ada}\n"


@pytest.fixture
def hosts(tmp_path):
    path = tmp_path / "hosts.yaml"
    path.write_text(HOSTS)
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [("192.0.2.7", ("192.0.2.7", 0)), ("192.0.2.7:7447", ("192.0.2.7", 7447))],
)
def test_addresses(text, expected):
    assert parse_address(text) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot.local", "is no ADDRESS"),
        ("192.0.2.7:http", "is no ADDRESS"),
        ("192.0.2.7:70000", "a port is 1 to 65535"),
        ("192.0.2.7:-1", "a port is 1 to 65535"),
        ("224.0.0.1", "choose one"),
        ("0.0.0.0", "choose one"),
        ("[2001:db8::7]:7447", "IPv4 addresses only"),
        ("::", "IPv4 addresses only"),
        ("", "is no ADDRESS"),
    ],
)
def test_what_is_no_address(text, words):
    with pytest.raises(stepbus.WiringError, match=words):
        parse_address(text)


def test_a_host_is_its_address_and_user(hosts):
    assert read_hosts(hosts)["robot"].destination == "ada@robot.local"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- robot\n", "hosts.yaml"),
        ("robot: {adress: robot.local}\n", "did you mean 'address'"),
        ("robot: {address: robot.local, ssh: [3]}\n", "must be text"),
        ("robot: robot.local\n", "robot"),
    ],
)
def test_a_file_of_hosts_says_where_it_is_wrong(tmp_path, text, words):
    path = tmp_path / "hosts.yaml"
    path.write_text(text)
    with pytest.raises(stepbus.WiringError, match=words):
        read_hosts(path)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"listen": "127.0.0.1"}, "which the scenario has none of"),
        ({"hosts": "hosts"}, "no participant has a host"),
        ({"set": {"controller.host": "robot"}}, "say with --hosts FILE where that is"),
        ({"set": {"controller.host": "robt"}, "hosts": "hosts"}, "did you mean 'robot'"),
        ({"set": {"controller.host": "robot"}, "in_process": True}, "a process of its own"),
        (
            {"set": {"controller.host": "robot", "bus.transport": "tcp"}, "hosts": "hosts"},
            "TCP on loopback",
        ),
        (
            {"set": {"controller.host": "robot", "controller.start": "external"}},
            "participant that stepbus starts there",
        ),
    ],
)
def test_what_does_not_fit_is_refused_and_leaves_no_folder(tmp_path, hosts, given, words):
    given |= {"hosts": hosts} if "hosts" in given else {}
    with pytest.raises(stepbus.WiringError, match=words):
        stepbus.run("two_link", out=tmp_path / "run", **given)
    assert not (tmp_path / "run").exists()


def test_what_cannot_be_written_there_is_said_without_options_of_here(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingFailed) as failed:
        Sources(b"", {}).unpack(tmp_path / "file/source")
    assert sentence(failed.value, tmp_path).endswith(": exists and is not a folder")


@pytest.mark.parametrize("is_silent", [False, True])
def test_a_host_that_is_silent_is_cut_off_and_not_waited_for(tmp_path, is_silent):
    done = []
    host = SimpleNamespace(
        lost=lambda: "",
        silent_s=lambda: 9.0 if is_silent else 0.0,
        send=lambda order: done.append(signal.Signals(order.number).name),
    )
    process = RemoteProcess(host, "controller", tmp_path / "log")
    process.cut = lambda: done.append("cut")
    process.wait = lambda seconds: done.append(f"wait {seconds:g} s")
    process.end(0.0)
    ended = ["SIGTERM", "SIGCONT", "wait 0 s", "cut", "SIGKILL"]
    assert done == ended + ["wait 5 s"] * (not is_silent)
