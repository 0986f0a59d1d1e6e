"""Another user of this machine, who attacks: the test makes one where it may."""

import contextlib
import os
import subprocess
import sys

import pytest

NOBODY = 65534
needs_second_user = pytest.mark.skipif(
    os.getuid() != 0, reason="only root can become another user of this machine"
)
_BECOME = f"import os; os.setgroups([]); os.setgid({NOBODY}); os.setuid({NOBODY})\n"


@contextlib.contextmanager
def second_user(program, *words, is_other=True):
    """Run a Python program as another user, with `words` in `sys.argv`; yields its process.

    It has the standard library, imported before it becomes that user. is_other: else as this one.
    """
    imports = "import encodings.idna, os, socket, sys, threading, time, urllib.request\n"
    text = imports + (_BECOME if is_other else "") + program
    command = [sys.executable, "-I", "-S", "-c", text, *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()
