"""Limits as `ulimit` sets them."""

from __future__ import annotations

import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from campaign.sandbox import Sandbox

from .disks import limit_files

NOBODY = 65534
_AS_NOBODY = """
set -e
mount --bind {home} {kept}; mount -t tmpfs none /root; chmod 755 /root
mkdir -p {home}; mount --bind {kept} {home}
exec setpriv --reuid={user} --regid={user} --clear-groups prlimit --nproc={number} "$@"
"""


def few_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to few open files (ulimit -n)."""
    number = chance.choice((chance.randrange(5, 16), chance.randrange(16, 80)))
    return _limit(resource.RLIMIT_NOFILE, number)


def small_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to small files (ulimit -f)."""
    return limit_files(1024 * chance.randrange(1, 2000))


def little_memory(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little address space (ulimit -v)."""
    return _limit(resource.RLIMIT_AS, chance.randrange(60, 2000) << 20)


def little_time(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little processor time (ulimit -t)."""
    return _limit(resource.RLIMIT_CPU, chance.randrange(1, 4))


def few_processes(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
    """Limit the user to few processes and threads (ulimit -u); root has no such limit."""
    number = chance.choice((chance.randrange(1, 12), chance.randrange(12, 60)))
    if os.geteuid():
        return _limit(resource.RLIMIT_NPROC, number)
    box.notes["wrapper"] = _as_nobody(box, number)
    return None


def _as_nobody(box: Sandbox, number: int) -> list[str]:
    """Return a command that runs another one as `nobody`, in a namespace where it may read us."""
    home = Path(sys.base_prefix)
    if shutil.which("unshare") is None or shutil.which("setpriv") is None:
        return []
    kept = box.home / "kept"
    kept.mkdir()
    for folder in (box.home, box.home / "disk", box.temporary):
        os.chown(folder, NOBODY, NOBODY)
    words = {"home": home, "kept": kept, "user": NOBODY, "number": number}
    script = _AS_NOBODY.format(**words)
    if not home.is_relative_to("/root"):
        script = script.splitlines()[-1]
    command = ["unshare", "--mount", "bash", "-c", script, "bash"]
    works = subprocess.run([*command, sys.executable, "-c", ""], capture_output=True, check=False)
    return command if works.returncode == 0 or number < 3 else []


def _limit(what: int, number: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(what, (number, number))
