"""Whether a state of an FMU goes on as the FMU itself, when it is restored in another process.

`python -m stepbus_fmi.proof FMU …` does some steps, saves, does two more, and writes both; with a
state on standard input, it restores that and does the two. FMUs save pointers, of which some go
wrong in another process, and their program may end the process that tries it.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from stepbus_participant import Problems, scratch_folder
from stepbus_schemas import StepbusError

from .params import Params

_STEPS, _PROBED = 10, 2
_LONGEST_S = 12.0


def state_problem(params: Params, h: float) -> str:
    """Return why the state of an FMU cannot be used in another process; nothing: it can.

    h: length of a step [s]. It starts two processes, one after the other.
    """
    asked = [str(params.fmu), params.inside, json.dumps(params.start), repr(params.start_time)]
    words = [sys.executable, "-P", "-m", __name__, *asked, repr(h), json.dumps(params.event_mode)]
    try:
        # One that crashes leaves what it has unpacked.
        with tempfile.TemporaryDirectory(prefix="stepbus-fmu-", dir=scratch_folder()) as folder:
            state, outputs = json.loads(_ran(words, b"", folder))
            again = json.loads(_ran(words, bytes.fromhex(state), folder))[1]
    except (OSError, ValueError, subprocess.SubprocessError) as exc:
        return f"a trial in another process failed: {_why(exc)}"
    return "" if again == outputs else "restored in another process, it goes another way"


def _why(exc: Exception) -> str:
    if isinstance(exc, subprocess.CalledProcessError):
        last = exc.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        return last or f"it ended with signal {-exc.returncode}" if exc.returncode < 0 else last
    return (
        f"no answer within {_LONGEST_S:g} s"
        if isinstance(exc, subprocess.TimeoutExpired)
        else str(exc)
    )


def _ran(words: Sequence[str], state: bytes, folder: str) -> bytes:
    done = subprocess.run(
        words,
        input=state,
        capture_output=True,
        timeout=_LONGEST_S,
        check=True,
        env={**os.environ, "TMPDIR": folder},
    )
    return done.stdout.rpartition(b"\n")[2]


def _main(fmu: str, inside: str, start: str, time: str, h: str, event_mode: str) -> None:
    # Only the process that tries a state needs FMPy here.
    from .instance import Instance  # noqa: PLC0415
    from .model import read_model  # noqa: PLC0415
    from .participant import by_type  # noqa: PLC0415
    from .start import start_values  # noqa: PLC0415
    from .units import Units  # noqa: PLC0415

    given = json.loads(start)
    model = read_model(Path(fmu), inside, given)
    values = start_values(model, Units(model.description), given, Problems())
    instance = Instance(model, Path(fmu), inside)
    state = sys.stdin.buffer.read()
    try:
        instance.instantiate(event_mode=json.loads(event_mode))
        instance.initialize(values, float(time), None)
        groups = [group for group, _ in by_type(instance, model.of("output"))]

        def go(first: int, count: int) -> list[str]:
            found = []
            for step in range(first, first + count):
                if not instance.ended:
                    ends = (float(time) + n * float(h) for n in (step, step + 1))
                    instance.step(*ends)
                found.append(repr([instance.get(group) for group in groups]))
            return found

        if state:
            instance.restore(state)
        else:
            go(0, _STEPS)
            state = instance.save()
        answer = json.dumps([state.hex(), go(_STEPS, _PROBED)])
    finally:
        instance.close()
    sys.stdout.write(f"\n{answer}")


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except StepbusError as exc:
        sys.exit(str(exc))
