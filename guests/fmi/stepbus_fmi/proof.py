"""Whether a state of an FMU goes on as the FMU itself, when it is restored in another process.

`python -m stepbus_fmi.proof`, with a question on standard input, does some steps, saves, and does
two more; or it restores a state and does these two. The state of many FMUs has pointers, which may
be wrong in another process and end it.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_participant import Problems, scratch_folder
from stepbus_schemas import StepbusError

from .instance import Instance
from .model import read_model, start_values
from .params import Params

_STEPS, _PROBED = 10, 2
_LONGEST_S = 12.0


def state_problem(params: Mapping[str, Any], read: Params, h: float) -> str:
    """Return why the state of an FMU cannot be used in another process; nothing: it can.

    params: of the participant, as the scenario has them, and as read. h: length of a step [s].
    """
    question = {"params": {**params, "fmu": str(read.fmu)}, "h": h}
    try:
        # One that crashes leaves what it has unpacked.
        with tempfile.TemporaryDirectory(prefix="stepbus-fmu-", dir=scratch_folder()) as folder:
            state, outputs = _ask(question, folder)
            again = _ask({**question, "state": state}, folder)[1]
    except subprocess.CalledProcessError as exc:
        last = exc.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        return last if exc.returncode == 1 and last else f"it ended with signal {-exc.returncode}"
    except subprocess.TimeoutExpired:
        return f"a trial in another process was not done after {_LONGEST_S:g} s"
    return "" if again == outputs else "restored in another process, it goes another way"


def _ask(question: dict[str, Any], folder: str) -> Any:
    done = subprocess.run(
        [sys.executable, "-P", "-m", __name__],
        input=json.dumps(question).encode(),
        capture_output=True,
        timeout=_LONGEST_S,
        check=True,
        env={**os.environ, "TMPDIR": folder},
    )
    # Before it is what the FMU prints.
    return json.loads(done.stdout.rpartition(b"\n")[2])


def _main() -> None:
    asked = json.load(sys.stdin)
    params = Params.of(asked["params"], Path())
    model = read_model(params.fmu, params.inside, params.start)
    instance = Instance(model, params, start_values(model, params.start, Problems()))
    groups = instance.values(model.of("output"))

    def go(first: int, count: int) -> list[str]:
        found = []
        for step in range(first, first + count):
            if not instance.ended:
                instance.step(params.start_time + step * asked["h"], asked["h"])
            found.append(repr(instance.get(groups)))
        return found

    try:
        if "state" in asked:
            instance.restore(bytes.fromhex(asked["state"]))
        else:
            go(0, _STEPS)
        state = instance.save()
        answer = [state.hex(), go(_STEPS, _PROBED)]
    finally:
        instance.close()
    sys.stdout.write(f"\n{json.dumps(answer)}")


if __name__ == "__main__":
    try:
        _main()
    except StepbusError as exc:
        sys.exit(str(exc))
