"""`stepbus doctor --hosts`: which direction fails, and what to open."""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import threading

import pytest
from support.surroundings import comes_true
from support.tools import fake

from stepbus_hosts import check, versions
from stepbus_hosts.check import check_hosts
from stepbus_hosts.hosts_file import HostSpec
from stepbus_hosts.versions import compared, host_versions
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_schemas import WiringError

SSH = """#!/bin/sh
# All hosts are this one.
for last; do :; done
case " $* " in
  *" gone "*) echo "ssh: connect to host gone port 22: Connection refused" >&2; exit 255 ;;
  *" locked "*) echo "locked: Permission denied (publickey)." >&2; exit 255 ;;
esac
export SSH_CONNECTION="127.0.0.1 1 127.0.0.1 22"
exec sh -c "$last"
"""
BARE = "#!/bin/sh\necho \"No module named 'stepbus_hosts'\" >&2; exit 1\n"


@pytest.fixture
def local_ssh(tmp_path, monkeypatch):
    """Put an `ssh` on PATH that runs commands here."""
    folder = fake(tmp_path / "bin", "ssh", SSH)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def write_hosts(folder, **hosts):
    """Write a file of hosts, each with this Python and a folder below `folder`."""
    rows = {
        name: {"address": name, "python": sys.executable, "folder": str(folder / "there"), **row}
        for name, row in hosts.items()
    }
    path = folder / "hosts.yaml"
    path.write_text(json.dumps(rows))
    return path


def verdicts(rows):
    """Return what was checked → (verdict, text)."""
    return {what: (verdict, text) for what, verdict, text in rows}


def free_port():
    """Return a port that is closed."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


@pytest.mark.usefixtures("local_ssh", "nothing_is_left")
def test_a_host_that_is_reached_and_reaches_us(tmp_path, capsys):
    port = free_port()
    words = ["--listen", f"127.0.0.1:{port}", "--json"]
    assert main(["doctor", "--hosts", str(write_hosts(tmp_path, robot={})), *words]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["verdict"] for row in rows} == {"ok"}
    found = {row["what"]: row["text"] for row in rows}
    assert f"reaches 127.0.0.1:{port} in" in found["robot → here"]
    assert "round trip" in found["robot, times"]
    assert "which changes no result" in found["robot, times"]
    assert host_versions().keys() <= found.keys()
    assert list((tmp_path / "there/files").iterdir()) == []


@pytest.mark.usefixtures("local_ssh", "nothing_is_left")
def test_each_direction_that_fails_says_what_to_open(tmp_path):
    port = free_port()
    bare = fake(tmp_path / "bare", "python", BARE) / "python"
    (tmp_path / "file").touch()
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = other.getsockname()[1]
        hosts = write_hosts(
            tmp_path,
            gone={},
            locked={},
            bare={"python": str(bare)},
            full={"folder": str(tmp_path / "file")},
            shut={"reaches": f"127.0.0.1:{port}"},
            astray={"reaches": f"127.0.0.1:{taken}"},
        )
        found = verdicts(check_hosts(hosts, ""))
    parts = {
        "here → gone": "Connection refused; is sshd up there? Open its port (TCP 22 by default) inbound on gone",
        "here → locked": "let your key in there",
        "bare, agent": "install stepbus there, or name the right `python`",
        "full, agent": f"{tmp_path}/file",
        "shut → here": f"127.0.0.1:{port}: Connection refused; is `reaches` right, and does that forward connections to 127.0.0.1 here?",
        "astray → here": f"something else than this host answers it at 127.0.0.1:{taken}",
    }
    assert {what for what, (verdict, _) in found.items() if verdict == "fail"} == parts.keys()
    assert {what for what, part in parts.items() if part not in found[what][1]} == set()
    assert found["here → bare"][0] == "ok"


@pytest.mark.usefixtures("local_ssh")
def test_an_address_of_another_host_cannot_be_listened_on(tmp_path):
    found = verdicts(check_hosts(write_hosts(tmp_path, robot={}), "192.0.2.1:7447"))
    verdict, text = found["listen"]
    assert verdict == "fail"
    assert "192.0.2.1:7447 cannot be opened here: Cannot assign requested address" in text
    assert "behind a router" in text


@pytest.mark.usefixtures("local_ssh")
def test_a_port_that_is_taken_is_told_as_that_by_doctor_and_run(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        _, text = verdicts(check_hosts(write_hosts(tmp_path, robot={}), listen))["listen"]
        words = ["--external", "controller", "--listen", listen, "--out", str(tmp_path / "out")]
        assert main(["run", "two_link", *words]) == ExitCode.BUS
    why = f"{listen} cannot be opened here: Address already in use; another run or program has it"
    assert text.startswith(why)
    assert why in capsys.readouterr().err


@pytest.mark.usefixtures("local_ssh", "nothing_is_left")
def test_what_the_user_keeps_in_the_folder_there_stays(tmp_path):
    files = tmp_path / "there/files"
    (files / "folder").mkdir(parents=True)
    ours = files / f"{1:064x}"
    for path in (ours, files / "thesis.tex"):
        path.touch()
    for path in files.iterdir():
        os.utime(path, (0, 0))
    found = verdicts(check_hosts(write_hosts(tmp_path, robot={}), ""))
    assert found["robot, agent"][0] == "ok"
    assert {path.name for path in files.iterdir()} == {"folder", "thesis.tex"}


@pytest.mark.parametrize("reaches", ["router", "192.0.2.7:70000"])
def test_reaches_is_checked_before_anything_is_started(tmp_path, reaches):
    hosts = write_hosts(tmp_path, robot={"reaches": reaches})
    with pytest.raises(WiringError, match=rf"hosts.yaml:1: robot.reaches: '{reaches}'"):
        next(check_hosts(hosts, ""))


@pytest.mark.parametrize(
    ("origin", "reaches", "port", "words"),
    [
        ("192.0.2.7", "", 7447, "open TCP port 7447 inbound on this host"),
        ("192.0.2.9", "", 7447, "this host, or --listen 192.0.2.9, from where SSH comes to it"),
        ("192.0.2.7", "", 0, "and name it, here and for `stepbus run`: --listen 192.0.2.7:7447"),
        ("192.0.2.7", "203.0.113.1", 7447, "does that forward connections to 192.0.2.7 here?"),
    ],
)
def test_what_to_open(origin, reaches, port, words):
    host = check.Host("robot", HostSpec(address="robot", reaches=reaches), threading.Event())
    host.origin = origin
    assert check.advice(host, "192.0.2.7", port).endswith(words)


def test_versions_that_differ_are_told_by_host():
    one = {"stepbus": "1", "protocol": "2", "numpy": "2"}
    there = {"stepbus": "1", "numpy": "3", "pin": "4"}
    assert list(compared({"here": one, "robot": there})) == [
        ("stepbus", True, "1 everywhere"),
        ("protocol", False, "here 2, robot none"),
        ("numpy", False, "here 2, robot 3"),
        ("pin", True, "here none, robot 4"),
    ]


def test_a_package_that_a_host_lacks_has_no_version(monkeypatch):
    monkeypatch.setattr(versions, "_PACKAGES", ("msgspec", "no-such-package"))
    found = host_versions()
    assert found["msgspec"]
    assert found["no-such-package"] == ""


def test_the_message_types_that_ship_are_compared(monkeypatch):
    before = host_versions()["message types"]
    fewer = dict(list(versions.MESSAGE_TYPES.items())[1:])
    monkeypatch.setattr(versions, "MESSAGE_TYPES", fewer)
    assert host_versions()["message types"] != before


def test_what_is_no_address_and_listening_for_nobody_are_refused(tmp_path, capsys):
    with pytest.raises(WiringError, match="of several networks"):
        list(check_hosts(write_hosts(tmp_path, robot={}), "0.0.0.0:7447"))
    for port in (-1, 70000):
        with pytest.raises(WiringError, match=f"192.0.2.7:{port}': a port is 1 to 65535"):
            list(check_hosts(write_hosts(tmp_path, robot={}), f"192.0.2.7:{port}"))
    assert main(["doctor", "--listen", "127.0.0.1"]) == ExitCode.SCENARIO
    assert "--listen is for --hosts" in capsys.readouterr().err


@contextlib.contextmanager
def sshd(folder):
    """Start an sshd of our own, which lets this user in; yield the options of `ssh` for it."""
    program = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    if program is None or shutil.which("ssh") is None:
        pytest.skip("OpenSSH (ssh, sshd) is not installed")
    if os.geteuid() or shutil.which("unshare") is None:
        pytest.skip("an sshd with a /run/sshd of its own takes root and `unshare`")
    for name in ("host", "key"):
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name], check=True
        )
    port = free_port()
    settings = [
        f"Port {port}", "ListenAddress 127.0.0.1", f"HostKey {folder}/host", "PidFile none",
        "UsePAM no", "StrictModes no", f"AuthorizedKeysFile {folder}/key.pub",
    ]  # fmt: skip
    (folder / "sshd_config").write_text("\n".join(settings) + "\n")
    start = (
        f"mount -t tmpfs none /run && mkdir /run/sshd && exec {program} -De -f {folder}/sshd_config"
    )
    with (folder / "sshd.log").open("w") as log:
        server = subprocess.Popen(["unshare", "-m", "sh", "-c", start], stderr=log, stdout=log)
    try:
        log = folder / "sshd.log"
        up = comes_true(lambda: "listening" in log.read_text() or server.poll() is not None, 20)
        if not up or server.poll() is not None:
            pytest.skip(f"sshd does not start here: {log.read_text()}")
        yield [
            "-F", "none", f"-p{port}", f"-i{folder}/key", "-oStrictHostKeyChecking=no",
            "-oUserKnownHostsFile=/dev/null", "-oLogLevel=ERROR",
        ]  # fmt: skip
    finally:
        server.terminate()
        server.wait(20)


@pytest.mark.usefixtures("nothing_is_left")
def test_over_a_real_sshd(tmp_path):
    with sshd(tmp_path) as options:
        hosts = write_hosts(tmp_path, robot={"address": "127.0.0.1", "ssh": options})
        found = verdicts(check_hosts(hosts, ""))
    assert {verdict for verdict, _ in found.values()} == {"ok"}, found
    assert "reaches 127.0.0.1:" in found["robot → here"][1]
