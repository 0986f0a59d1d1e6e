"""Copies of this process, beside its threads."""

import subprocess
import sys

import pytest

PROGRAM = """
import os
import threading

from stepbus_participant.copies import Copy


def test_copy():
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    copy = Copy(lambda: b"drawn", 5, "it", os.sched_getaffinity(0))
    end.set()
    thread.join()
    assert copy.result() == b"drawn"
"""
warns = pytest.mark.skipif(sys.version_info < (3, 12), reason="Python 3.11 warns of no fork")


def output(folder, *options, more=""):
    """Return what Python prints that runs the program."""
    (folder / "test_program.py").write_text(PROGRAM + more)
    command = [sys.executable, *options, "test_program.py"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=folder)
    return done.stdout + done.stderr


@warns
def test_no_user_is_warned_of_a_copy_beside_threads(tmp_path):
    asked = ("-W", "default::DeprecationWarning")
    assert output(tmp_path, *asked, more="\ntest_copy()\n") == ""


@warns
def test_no_user_of_pytest_is_warned_of_one(tmp_path):
    told = output(tmp_path, "-m", "pytest", "-p", "no:cacheprovider")
    assert ("1 passed" in told, "warning" in told) == (True, False)
