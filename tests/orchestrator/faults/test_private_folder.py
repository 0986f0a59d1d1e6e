"""Whatever of a run's private folder is removed, at whatever moment of the start: one sentence."""

import json
import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from stepbus_orchestrator.errors import ExitCode

STEPBUS = str(Path(sys.executable).with_name("stepbus"))
DEADLINES = [
    f"{name}.{phase}_timeout=20s"
    for name in ("plant", "controller", "mission")
    for phase in ("spawn", "join", "ready")
]
# Python loads it before anything of ours. It counts what one process does with the private folder
# (and the processes it starts), and removes things right before the given one.
HOOK = """
import os, shutil, sys
from pathlib import Path

WHO, NUMBER, WHAT, COUNTS = (os.environ["HOOK_" + n] for n in ("WHO", "NUMBER", "WHAT", "COUNTS"))
count = 0
busy = False


def hook(event, args):
    global count, busy
    if busy or event == "import" or event.startswith(("object.", "sys.", "code.", "compile")):
        return
    # One that is forked gets its ticket later on.
    ticket = os.environ.get("STEPBUS_TICKET")
    if WHO != (Path(ticket).stem if ticket else "orchestrator"):
        return
    top = Path(os.environ["TMPDIR"])
    is_private = any(str(top / "stepbus-") in str(arg) for arg in args[:2])
    if not is_private and event != "subprocess.Popen":
        return
    busy = True
    count += 1
    if count == int(NUMBER):
        for folder in top.glob("stepbus-*"):
            if WHAT == "folder":
                shutil.rmtree(folder, ignore_errors=True)
            for path in folder.glob(WHAT):
                path.unlink(missing_ok=True)
    with open(COUNTS, "a") as file:
        file.write(f"{count} {event} {str(args[0])[-60:]}\\n")
    busy = False


if "reaper.py" not in " ".join(sys.argv):
    sys.addaudithook(hook)
"""


def run(folder, *, who, number, what, arguments=()):
    """Run two_link while a hook removes something; return how it ended, its result and moments."""
    for name in ("hook", "tmp"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "hook" / "sitecustomize.py").write_text(HOOK)
    counts = folder / "counts"
    counts.touch()
    sets = [word for item in ("duration=50ms", *DEADLINES) for word in ("--set", item)]
    done = subprocess.run(
        [STEPBUS, "run", "two_link", *sets, *arguments, "--no-report", "--out", folder / "run"],
        env={
            **os.environ,
            "PYTHONPATH": str(folder / "hook"),
            "TMPDIR": str(folder / "tmp"),
            "HOOK_WHO": who,
            "HOOK_NUMBER": str(number),
            "HOOK_WHAT": what,
            "HOOK_COUNTS": str(counts),
        },
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    result = json.loads((folder / "run" / "result.json").read_text())
    return done, result, len(counts.read_text().splitlines())


def check(folder, done, result):
    """Check a run whose private folder was damaged."""
    assert "Traceback" not in done.stdout + done.stderr
    assert done.returncode in {ExitCode.FINISHED, ExitCode.BUS}, done.stderr
    assert result["exit_code"] == done.returncode
    if done.returncode:
        assert result["participant"] is None
        assert "did another process remove it?" in done.stderr
    assert not list((folder / "tmp").iterdir())


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("transport", "what", "who", "every"),
    [
        ("unix", "folder", "orchestrator", 2),
        ("unix", "*", "controller", 1),
        ("tcp", "folder", "orchestrator", 7),
        ("tcp", "*", "plant", 1),
    ],
)
def test_whatever_vanishes_at_whatever_moment_nobody_is_blamed(
    tmp_path, transport, what, who, every
):
    arguments = ("--set", f"bus.transport={transport}")
    for number in count(1, every):
        folder = tmp_path / str(number)
        done, result, seen = run(folder, who=who, number=number, what=what, arguments=arguments)
        check(folder, done, result)
        if number > seen:
            break
    # It was removed before every moment that there is.
    assert number > 4
