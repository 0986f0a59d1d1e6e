"""The orchestrator's side of bulk content in files (P17): it makes them, and copies out of them."""

import contextlib
import ctypes
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.slots import slot_counts
from stepbus_participant import SlotError, file_name, read_slot
from stepbus_schemas import Outputs, Ready

_MEMORY = Path("/dev/shm")  # noqa: S108
_LEAST_ROOM = 1 << 28
"""Where there is less, as by default in a container, slots are with the run's other files [B]."""


class BulkSink(Protocol):
    """What takes the content of bulk outputs: the sink of a run."""

    def is_recorded(self, name: str, port: str, step: int) -> bool:
        """Return whether it takes what a port publishes at a step."""

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Take it."""


class RunSlots:
    """The slots of a run; without a scenario, none.

    folder: has a file for each bulk output; empty: there are none.
    """

    def __init__(self, scenario: Scenario | None = None, folder: str = "") -> None:
        self.folder = folder
        self._counts = {} if scenario is None else slot_counts(scenario)
        self._users: dict[str, set[str]] = {name: set() for name in self._counts}
        self._files: dict[str, int] = {}
        self._agreed: dict[str, int] = {}
        for spec in () if scenario is None else scenario.participants:
            for item in spec.inputs.values():
                name = file_name(item.source, item.port)
                if name in self._users:
                    self._users[name].add(spec.name)
            for port in spec.outputs:
                if (name := file_name(spec.name, port)) in self._users:
                    self._users[name].add(spec.name)
                    flags = os.O_RDONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
                    self._files[name] = os.open(Path(folder) / name, flags, 0o600)

    def agree(self, ready: Mapping[str, Ready]) -> dict[str, int]:
        """Return the outputs whose content goes through slots, with their number (P17.2).

        ready: what each participant says. All that use an output have to have opened its file.
        """
        opened = {name: set(one.slots) for name, one in ready.items()}
        self._agreed = {
            name: count
            for name, count in self._counts.items()
            if all(name in opened.get(user, ()) for user in self._users[name])
        }
        return self._agreed

    def take(self, name: str, outputs: Outputs, sink: BulkSink) -> str | None:
        """Hand on the content that is in slots; return what is wrong with it, or None.

        To be called before the outputs count as reported: then their slots may be reused.
        """
        for port, offset in outputs.slots.items():
            output = file_name(name, port)
            length = outputs.bulk.get(port)
            if output not in self._agreed or length is None:
                return f"announced {port!r} in a slot, but no slots were agreed on"
            if sink.is_recorded(name, port, outputs.step):
                try:
                    content = read_slot(self._files[output], offset, outputs.step, length)
                except SlotError as exc:
                    return f"announced {port!r}, and {exc}"
                sink.offer_bulk(name, port, outputs.step, content)
        return None

    def close(self) -> None:
        """Close the files; the reaper removes them."""
        while self._files:
            os.close(self._files.popitem()[1])


def make_slots(scenario: Scenario, launcher: Launcher) -> RunSlots:
    """Make the files for the bulk outputs of a scenario, which go with the private folder.

    They are in memory, where there is room. Where none can be made, there are no slots.
    """
    if not slot_counts(scenario):
        return RunSlots()
    try:
        slots = RunSlots(scenario, str(_folder(launcher)))
    except OSError:
        return RunSlots()
    _keep_memory()
    return slots


def _folder(launcher: Launcher) -> Path:
    if _MEMORY not in launcher.folder.parents:
        with contextlib.suppress(OSError):
            room = os.statvfs(_MEMORY)
            if room.f_bavail * room.f_frsize >= _LEAST_ROOM:
                folder = Path(tempfile.mkdtemp(prefix="stepbus-", dir=_MEMORY))
                launcher.remove_too(folder)
                return folder
    folder = launcher.folder / "slots"
    folder.mkdir(0o700)
    return folder


_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3
"""Parameters of mallopt(3)."""


def _keep_memory() -> None:
    """Let the C library keep up to 128 MB of what this process frees, where it is glibc.

    Otherwise it gives the memory of each picture back to the kernel, and each page of the next one
    is a page fault: half the time of a step with pictures of 2.76 MB.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, 32 << 20)
        mallopt(_M_TRIM_THRESHOLD, 128 << 20)
        mallopt(_M_TOP_PAD, 16 << 20)
