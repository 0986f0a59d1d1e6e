"""How late the steps of a run in real time were."""

from pathlib import Path

import msgspec

from stepbus_orchestrator.toolkit import RESULT_FILE, Lateness
from stepbus_participant import read_file
from stepbus_schemas import UNDECODABLE


class _Result(msgspec.Struct):
    real_time: Lateness | None = None


def read_lateness(folder: Path) -> Lateness | None:
    """Return how late the steps of a run were; None where it was not in real time.

    folder: of the run; its result.json has it.
    """
    try:
        return msgspec.json.decode(read_file(folder / RESULT_FILE), type=_Result).real_time
    except (OSError, *UNDECODABLE):
        return None
