"""What other users of the machine can see of the page of a run."""

import os
import stat
import subprocess
import sys
from urllib.parse import urlparse
from urllib.request import url2pathname

BROWSER = """#!/bin/sh
printf '%s\\n' "$1" > "$OUT/given"
file=$(printf '%s' "$1" | sed 's,^file://,,')
cp -p "$file" "$OUT/file"
ls -ld "$(dirname "$file")" | cut -c1-10 > "$OUT/folder"
"""
OPEN = """
from stepbus_orchestrator.viewing.access import open_in_browser
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
