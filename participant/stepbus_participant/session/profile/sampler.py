"""Samples the stack of a participant, for speedscope.app."""

import json
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Self

from stepbus_participant.files import write_file

_PERIOD_S = 0.001
_JOIN_S = 1.0
_MOST_SAMPLES = 200_000
_SCHEMA = "https://www.speedscope.app/file-format-schema.json"
_Place = tuple[str, str, int]


class Sampler:
    """Samples the calls below one frame about every millisecond, until it is left.

    frame: below it a participant works; samples without it are not the participant's, in a run in
    one process. path: the file, written at the end.
    """

    def __init__(self, name: str, frame: FrameType, path: Path) -> None:
        self._name = name
        self._frame = frame
        self._path = path
        self._thread = threading.get_ident()
        self._over = threading.Event()
        self._places: dict[_Place, int] = {}
        self._samples: list[list[int]] = []
        self._weights: list[float] = []
        self._worker = threading.Thread(target=self._work, name="sampler", daemon=True)

    def __enter__(self) -> Self:
        self._worker.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._worker.join(_JOIN_S)
        del self._frame
        write_file(self._path, json.dumps(self._profile()).encode())

    def _work(self) -> None:
        sampled_at = time.perf_counter()
        while not self._over.wait(_PERIOD_S) and len(self._samples) < _MOST_SAMPLES:
            stack = self._stack()
            now = time.perf_counter()
            if stack:
                self._samples.append(stack)
                self._weights.append(now - sampled_at)
            sampled_at = now

    def _stack(self) -> list[int]:
        """Return the places of the calls below the frame, outermost first; empty: elsewhere."""
        frame, found = sys._current_frames().get(self._thread), list[int]()
        while frame is not None:
            if frame is self._frame:
                return found[::-1]
            code = frame.f_code
            place = (code.co_qualname, code.co_filename, code.co_firstlineno)
            found.append(self._places.setdefault(place, len(self._places)))
            frame = frame.f_back
        return []

    def _profile(self) -> dict[str, object]:
        frames = [{"name": name, "file": file, "line": line} for name, file, line in self._places]
        sampled = {
            "type": "sampled",
            "name": self._name,
            "unit": "seconds",
            "startValue": 0,
            "endValue": sum(self._weights),
            "samples": self._samples,
            "weights": self._weights,
        }
        return {"$schema": _SCHEMA, "shared": {"frames": frames}, "profiles": [sampled]}
