"""Tickets on another host: as a line, copied by hand, of a run that is over or out of reach."""

import base64
import contextlib
import socket
import ssl
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import msgspec
import pytest
import trustme
from support.runs.elsewhere import JOIN, SHORT, Elsewhere, Watcher
from support.runs.joints import run_joints, write_scenario

from stepbus_hosts.gateway import Gateway
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.terminal.output import fold
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes import ticket_line
from stepbus_orchestrator.processes.attached import JoinTicket
from stepbus_orchestrator.processes.ticket_line import MARK, check_reachable, content_of, line_of
from stepbus_orchestrator.run.extensions.external import External
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Endpoint
from stepbus_schemas import WiringError

TLS = "transport/link/tls/"


def ticket(endpoint=None, **fields):
    """Return a ticket for `stepbus join`."""
    given = {"run": "r", "name": "controller", "token": "t", "folder": "", "bridge": "", **fields}
    endpoint = endpoint or Endpoint(listen=[], connect=["unixsock-stream//nowhere"])
    return JoinTicket(endpoint=endpoint, exec=("true",), describe={}, **given)


def tls_ticket(port, authority):
    """Return a ticket of a run on another host, with a certificate of its authority."""
    issued = authority.issue_cert("127.0.0.1", common_name="controller")
    pems = {
        "root_ca_certificate": authority.cert_pem,
        "connect_certificate": issued.cert_chain_pems[0],
        "connect_private_key": issued.private_key_pem,
    }
    settings = {
        f"{TLS}{name}_base64": base64.b64encode(pem.bytes()).decode() for name, pem in pems.items()
    }
    return ticket(Endpoint(listen=[], connect=[f"tls/127.0.0.1:{port}"], settings=settings))


@contextlib.contextmanager
def answering(answer):
    """Listen on a port, and answer the first that comes; yield the port."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def work():
            with contextlib.suppress(OSError):
                link, _ = server.accept()
                with link:
                    answer(link)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join(20)


def as_run(authority):
    """Return what answers as a run with that authority does."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1", common_name=".gateway").configure_cert(context)
    authority.configure_trust(context)
    context.verify_mode = ssl.CERT_REQUIRED

    def answer(link):
        with context.wrap_socket(link, server_side=True) as safe:
            safe.recv(1)

    return answer


# --- the line ---------------------------------------------------------------------------------


def test_a_line_is_one_word_with_the_whole_ticket():
    given = ticket(files={"a b.yaml": "0" * 64})
    line = line_of(given)
    assert line.replace("-", "").replace("_", "").replace("=", "").replace(":", "").isalnum()
    assert msgspec.json.decode(content_of(line), type=JoinTicket) == given


@pytest.mark.parametrize(
    "line",
    [
        line_of(ticket())[:-8],
        f"{line_of(ticket())[:40]} {line_of(ticket())[40:]}",
        f"{MARK}",
        f"{MARK}äöü",
        MARK + base64.urlsafe_b64encode(zlib.compress(bytes(1 << 24))).decode(),
    ],
)
def test_what_is_not_the_whole_line_is_refused(line, capsys):
    assert main(["join", line]) == ExitCode.SCENARIO
    assert "this is not the whole line of a ticket" in capsys.readouterr().err


def test_a_terminal_breaks_the_line_nowhere():
    line = line_of(ticket())
    assert fold(f"some words and\n{line}", 80, "    ").endswith(f"\n{line}")


@pytest.mark.usefixtures("nothing_is_left")
def test_a_participant_that_is_joined_by_a_line_gives_the_bytes_of_a_child(tmp_path):
    as_child = run_joints(tmp_path / "child", *SHORT, in_process=True)
    scenario = load(write_scenario(tmp_path / "source"), [*SHORT, "controller.start=external"])
    options = Options(out=tmp_path / "out", extensions=[External({"controller": Path("-")})])

    def invited():
        *_, line = watcher.told[-1].splitlines()
        elsewhere.join(line)

    watcher = Watcher(invited=invited)
    with contextlib.closing(Elsewhere()) as elsewhere:
        result = run(scenario, options, watcher)
    assert (result.exit_code, result.sha256) == (0, as_child.sha256)


def test_the_ticket_of_a_line_is_in_memory_for_the_program_and_all_it_starts(tmp_path):
    script = 'echo "$STEPBUS_TICKET"; ls -lL "$STEPBUS_TICKET"; cat "$STEPBUS_TICKET"'
    # What Python starts inherits no descriptor, as a program behind a bridge.
    program = tmp_path / "program.py"
    program.write_text(f"import subprocess\nsubprocess.run(['sh', '-c', {script!r}], check=True)\n")
    given = ticket()
    command = [*JOIN, line_of(given), "--", sys.executable, program]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    path, listed, content = done.stdout.splitlines()
    assert listed.startswith("-rw-------")
    assert msgspec.json.decode(content, type=JoinTicket) == given
    assert not Path(path).exists()


# --- a copied ticket --------------------------------------------------------------------------


def test_a_copy_that_others_may_read_is_refused_as_a_key_is(tmp_path, capsys):
    path = tmp_path / "c.ticket"
    ticket().save(path)
    path.chmod(0o644)
    assert main(["join", str(path)]) == ExitCode.SCENARIO
    assert f"others may read it; run `chmod 600 {path}`" in capsys.readouterr().err
    path.chmod(0o600)
    assert subprocess.run([*JOIN, path], check=False, timeout=60).returncode == 0


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


def test_the_run_of_a_ticket_is_reached(authority):
    with answering(as_run(authority)) as port:
        check_reachable(tls_ticket(port, authority))


def test_a_port_that_is_closed_is_told(authority, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    path = tmp_path / "c.ticket"
    tls_ticket(port, authority).save(path)
    assert main(["join", str(path)]) == ExitCode.SCENARIO
    sentence = f"127.0.0.1:{port} cannot be reached: Connection refused; is the run over, or is the port closed by a firewall?"
    assert sentence in capsys.readouterr().err


def test_a_port_that_does_not_answer_is_told(authority, monkeypatch):
    monkeypatch.setattr(ticket_line, "_REACH_S", 0.2)
    with (
        answering(lambda link: link.recv(1 << 20) and link.recv(1)) as port,
        pytest.raises(
            WiringError, match=r"cannot be reached: .*(timed out|no answer within 0\.2 s)"
        ),
    ):
        check_reachable(tls_ticket(port, authority))


@pytest.mark.parametrize("other", ["run", "sshd"])
def test_another_run_at_that_port_is_told(authority, other):
    answer = as_run(trustme.CA()) if other == "run" else lambda link: link.sendall(b"SSH-2.0-x\r\n")
    with (
        answering(answer) as port,
        pytest.raises(WiringError, match="answers, but not as the run of this ticket"),
    ):
        check_reachable(tls_ticket(port, authority))


@pytest.mark.usefixtures("nothing_is_left")
def test_a_gateway_counts_no_stranger_where_a_ticket_looks_for_it():
    told = []
    here = Endpoint(listen=[], connect=[], low_latency=False, user=".gateway", password="p")
    gateway = Gateway(
        here, "r", ["controller"], address="127.0.0.1", port=0, lease_s=10.0, tell=told.append
    )
    with contextlib.ExitStack() as stack:
        stack.callback(gateway.close)
        given = ticket(gateway.endpoint_of("controller"))
        for _ in range(3):
            check_reachable(given)
    assert (gateway.refused, told) == (0, [])


def test_a_client_that_gets_no_link_names_the_address():
    program = """
from stepbus_participant import BusError, Endpoint, ZenohBus
from stepbus_participant.bus import zenoh_bus
zenoh_bus._OPEN_S = 0.5
endpoint = Endpoint(listen=[], connect=["tcp/127.0.0.1:1"], settings={"mode": "client"})
try:
    ZenohBus(endpoint, "r")
except BusError as exc:
    print(exc, flush=True)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.strip() == (
        "127.0.0.1:1 cannot be reached: no link within 0.5 s; is the run over, does another process use its ticket, or is the port "
        "closed by a firewall?"
    )
