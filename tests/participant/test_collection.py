"""Python's collection of garbage in the process of a participant, which its start leaves out."""

import gc
import subprocess
import sys

import pytest

DEFAULT = gc.get_threshold()
"""Of this Python, which pytest leaves as it is."""
PARTICIPANT = """
import atexit, gc, stepbus
{line}
atexit.register(lambda: print(gc.isenabled(), gc.get_threshold()))

class Mine(stepbus.Participant):
    pass
"""


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", f"True {DEFAULT}"),
        ("gc.disable()", f"False {DEFAULT}"),
        ("gc.set_threshold(5000, 20, 30)", "True (5000, 20, 30)"),
    ],
)
def test_garbage_is_collected_as_the_module_of_a_participant_has_it(tmp_path, line, expected):
    (tmp_path / "mine.py").write_text(PARTICIPANT.format(line=line))
    command = [sys.executable, "-P", "-m", "stepbus_participant", "mine.py:Mine"]
    done = subprocess.run(
        command, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout.strip()) == (2, expected), done.stderr
