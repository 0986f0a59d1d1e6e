"""The orchestrator's side of bulk content (P17): how many slots, their files, their content."""

import contextlib
import ctypes
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import SlotError, file_name, read_slot
from stepbus_schemas import Outputs, Ready

_MEMORY = Path("/dev/shm")  # noqa: S108
_LEAST_ROOM = 1 << 28
"""Where there is less, as by default in a container, slots are with the run's other files [B]."""


class BulkSink(Protocol):
    """The sink of a run, as far as bulk content goes into it."""

    def is_recorded(self, name: str, port: str, step: int) -> bool:
        """Return whether the output of a step is recorded."""

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Store the content of an output until its step is recorded."""


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
        """Return output → number of slots, of the outputs whose content goes through slots (P17.2).

        ready: of each participant. All that use an output have to have opened its file.
        """
        opened = {name: set(message.slots) for name, message in ready.items()}
        self._agreed = {
            name: count
            for name, count in self._counts.items()
            if all(name in opened.get(user, ()) for user in self._users[name])
        }
        return self._agreed

    def take(self, name: str, outputs: Outputs, sink: BulkSink) -> str | None:
        """Pass the content of slots to the sink; return the problem with it, or None.

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
    """Make the files for the bulk outputs of a scenario, which are removed with the private folder.

    They are in memory, where there is room. Where no file can be made, there are no slots.
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


# --- how many -------------------------------------------------------------------------------


def slot_counts(scenario: Scenario, *, has_feedback: bool = True) -> dict[str, int]:
    """Return bulk output, `<participant>.<port>` → its number of slots; none on TCP.

    has_feedback: whether sources wait for the outputs that they read, as in a run.
    """
    return {
        file_name(spec.name, port): _count(
            scenario, spec, port, has_feedback=has_feedback and output.record == "off"
        )
        for spec in scenario.participants
        for port, output in spec.outputs.items()
        if output.bulk and scenario.bus.transport == "unix"
    }


def _count(scenario: Scenario, source: ParticipantSpec, port: str, *, has_feedback: bool) -> int:
    """Return after how many of its own the source may reuse a slot.

    Who publishes step k knows that all have reported their steps up to k − window. A reader has
    taken what was published `delay` before a step it does, once it reports that step, or, where it
    publishes first, the next one. It does every `every`-th. Where the source reads that reader,
    it is not a whole window ahead of it; of the orchestrator, which takes what is recorded, it is.
    """
    window = scenario.window
    needed = [1 if has_feedback else window]
    for spec in scenario.participants:
        for item in spec.inputs.values():
            if (item.source, item.port) == (source.name, port):
                lag = item.delay + spec.every - 1
                lag += spec.every if spec.publishes == "first" else 0
                ahead = _most_ahead(source, spec) if has_feedback else None
                needed.append(lag + (window if ahead is None else min(window, ahead)))
    if len(needed) == 1:
        needed.append(window)
    return -(-max(needed) // source.every)


def _most_ahead(source: ParticipantSpec, reader: ParticipantSpec) -> int | None:
    """Return how far a source gets ahead of a reader whose outputs it reads; None: it reads none.

    It publishes step k with what the reader has published at its newest step up to `delay` before
    k, or, where it publishes first, before its step before k.
    """
    own = source.every if source.publishes == "first" else 0
    delays = [item.delay for item in source.inputs.values() if item.source == reader.name]
    return min(delays) + own if delays else None
