"""What other users of the machine, and pages of other servers, can see of the page of a run."""

import http.client
import os
import signal
import stat
import subprocess
import sys
from urllib.parse import urljoin, urlparse
from urllib.request import url2pathname

import pytest
import viser
from support.browser import needs_chromium, opened
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

BROWSER = """#!/bin/sh
printf '%s\\n' "$1" > "$OUT/given"
file=$(printf '%s' "$1" | sed 's,^file://,,')
cp -p "$file" "$OUT/file"
ls -ld "$(dirname "$file")" | cut -c1-10 > "$OUT/folder"
"""
OPEN = """
from stepbus_tools.viewing.door import open_in_browser
open_in_browser("http://127.0.0.1:8080/s3cret-token/")
"""


def test_the_token_is_not_in_the_command_line_of_the_browser(tmp_path):
    browser, temporary = tmp_path / "browser", tmp_path / "tmp"
    browser.write_text(BROWSER)
    browser.chmod(0o755)
    temporary.mkdir()
    environment = {
        **os.environ, "BROWSER": f"{browser} %s", "OUT": str(tmp_path), "TMPDIR": str(temporary),
    }  # fmt: skip
    subprocess.run([sys.executable, "-c", OPEN], env=environment, check=True, umask=0)
    given = (tmp_path / "given").read_text().strip()
    assert "s3cret" not in given
    assert url2pathname(urlparse(given).path).startswith(str(temporary))
    assert 'url=http://127.0.0.1:8080/s3cret-token/"' in (tmp_path / "file").read_text()
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o600
    assert (tmp_path / "folder").read_text() == "drwx------\n"
    assert list(temporary.iterdir()) == []


@pytest.fixture(scope="module")
def recording(tmp_path_factory, plain_run):
    return plain_run.recording


@pytest.fixture
def view(tmp_path, recording):
    """`stepbus view` of a recording, with a browser that only notes what it was given."""
    (tmp_path / "browser").write_text(BROWSER)
    (tmp_path / "browser").chmod(0o755)
    environment = {
        **os.environ, "BROWSER": f"{tmp_path / 'browser'} %s", "OUT": str(tmp_path),
        "TMPDIR": str(tmp_path),
    }  # fmt: skip
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", "view", recording]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        yield process
        process.send_signal(signal.SIGINT)
        process.communicate()


def address_of(view):
    return view.stdout.readline().split()[-1]


def get(address, **headers):
    """Return status, headers and text of what a server answers."""
    parts = urlparse(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=60)
    connection.request("GET", parts.path, headers=headers)
    response = connection.getresponse()
    found = response.status, response.headers, response.read().decode(errors="replace")
    connection.close()
    return found


UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
}  # fmt: skip


def test_a_page_is_for_those_who_have_its_token(view):
    address = address_of(view)
    for _ in range(2):
        status, headers, text = get(address)
        assert (status, " · stepbus</title>" in text) == (200, True)
        assert 'type="image/svg+xml" href="data:image/svg+xml,%3Csvg' in text
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    for place in ("/", "/guess/", "/index.html"):
        assert get(urljoin(address, place))[0] == 403
        assert get(urljoin(address, place), **UPGRADE)[0] == 403


def test_pages_of_other_servers_are_refused(view):
    address = address_of(view)
    place = urlparse(address).netloc
    assert get(address, **UPGRADE, Origin=f"http://{place}")[0] == 101
    for origin in ("null", "http://evil.example", f"http://{place}.evil.example", "file://"):
        assert get(address, **UPGRADE, Origin=origin)[0] == 403


def test_the_port_of_viser_itself_shows_strangers_nothing(page):
    port, token = page.server.get_port(), urlparse(page.address).path
    protocol = [f"viser-v{viser.__version__}"]
    with connect(f"ws://127.0.0.1:{port}{token}", subprotocols=protocol) as known:
        assert known.recv(timeout=60)
    for path in ("/", "/guess/"):
        with (
            connect(f"ws://127.0.0.1:{port}{path}", subprotocols=protocol) as stranger,
            pytest.raises(ConnectionClosed),
        ):
            stranger.recv(timeout=60)


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_the_file_of_the_browser_opens_the_page_which_can_be_loaded_again(view, tmp_path):
    view.stdout.readline()
    view.stdout.readline()
    while not (tmp_path / "folder").exists():
        assert view.poll() is None
    with opened((tmp_path / "given").read_text().strip(), 640, 360) as watched:
        for _ in range(2):
            watched.wait(lambda: watched.page.get_by_text("step 0 of").count() > 0, "the page")
            watched.wait(lambda: watched.colours() > 200, "the arm to be drawn")
            assert watched.page.evaluate("document.cookie") == ""
            watched.page.reload()
    assert not watched.errors
    assert not watched.strangers
