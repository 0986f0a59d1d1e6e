"""Draws what cameras see: beside the steps, and beside each other.

A picture is drawn in a copy of the process, which has the world as it is when the picture is taken:
so its pixels are those that the plant itself would draw, whatever engine it uses. What is drawn
where is decided by what it takes, and changes no result.
"""

import contextlib
import os
import sys
from collections.abc import Collection, Mapping
from functools import cached_property, partial
from time import perf_counter
from typing import Any

from stepbus_participant.copies import Copy
from stepbus_plant.camera import Camera, Rendering

_WORTH_S = 0.01
"""What a picture has to take for a copy to be faster, which takes 2 ms, and 8 of another core."""

_MOST = 2
"""Processes under way, for each core: however long the latency, the plant gets no further ahead."""


class _Picture:
    """A picture that a camera takes now.

    due_ns: when it is put out [ns]. cores: a copy may run on; none: it is drawn here. is_beside:
    whether it is drawn in a copy.
    """

    def __init__(self, camera: Camera, t_ns: int, cores: Collection[int]) -> None:
        self.camera, self.due_ns = camera, t_ns + camera.latency_ns
        self._t_ns = t_ns
        self._copy: Copy | None = None
        if cores:
            what = f"camera {camera.name!r}, image of {t_ns / 1e9:g} s"
            # Where there can be no further process, it is drawn here.
            with contextlib.suppress(OSError):
                self._copy = Copy(partial(camera.pixels, t_ns), camera.size, what, cores)
        self.is_beside = self._copy is not None

    @cached_property
    def rendering(self) -> Rendering:
        """Colours and depth, once they are drawn; raises RunError where a copy has failed."""
        if self._copy is None:
            return self.camera.render(self._t_ns)
        return self.camera.rendering(self._copy.result())

    @property
    def is_process(self) -> bool:
        """Return whether it has a process yet, which may have ended."""
        return self.is_beside and "rendering" not in self.__dict__

    def end(self) -> None:
        """Draw no further."""
        if self._copy is not None:
            self._copy.end()


class Drawing:
    """Takes and draws the pictures of those cameras that outputs show.

    has_copies: whether a copy of the process can draw.
    """

    def __init__(self, *, has_copies: bool) -> None:
        # As the process is started: while it runs, it may be kept on one of them.
        cores = os.sched_getaffinity(0) if has_copies and sys.platform == "linux" else ()
        self._cores: Collection[int] = cores if len(cores) > 1 else ()
        self._t_ns = -1
        self._cameras: list[Camera] = []
        self._took_s: dict[str, float] = {}
        self._under_way: list[_Picture] = []
        self._shown: dict[str, _Picture] = {}

    def save(self) -> dict[str, Any] | None:
        """Return the state of the cameras; None where one has no such, or images are under way."""
        states = {camera.name: camera.save() for camera in self._cameras}
        return None if self._under_way or None in states.values() else states

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Take what `save` returned."""
        for camera in self._cameras:
            camera.restore(saved[camera.name])

    @property
    def has_cameras(self) -> bool:
        """Return whether it draws anything."""
        return bool(self._cameras)

    def add(self, camera: Camera) -> None:
        """Draw the pictures of one more camera, once."""
        if camera not in self._cameras:
            self._cameras.append(camera)

    def images(self, camera: Camera, t_ns: int) -> Rendering | None:
        """Return what a camera puts out at a time [ns], drawn once for all ports; None: nothing."""
        if t_ns != self._t_ns:
            self._t_ns = t_ns
            self._take(t_ns)
        picture = self._shown.get(camera.name)
        return None if picture is None else picture.rendering

    def _take(self, t_ns: int) -> None:
        """Take the pictures of a time; what no copy draws is drawn before it returns."""
        taking = [camera for camera in self._cameras if camera.takes(t_ns)]
        now = [camera for camera in taking if not camera.latency_ns]
        # This process draws the last of them itself.
        beside = [c for c in now if self._took_s.get(c.name, 0.0) > _WORTH_S][:-1]
        beside += [camera for camera in taking if camera.latency_ns]
        pictures = [_Picture(c, t_ns, self._cores if c in beside else ()) for c in taking]
        for picture in pictures:
            if not picture.is_beside:
                began = perf_counter()
                _ = picture.rendering
                self._took_s[picture.camera.name] = perf_counter() - began
        self._under_way += pictures
        processes = [picture for picture in self._under_way if picture.is_process]
        for picture in processes[: -_MOST * max(len(self._cores), 1)]:
            _ = picture.rendering
        self._shown = {p.camera.name: p for p in self._under_way if p.due_ns == t_ns}
        self._under_way = [p for p in self._under_way if p.due_ns > t_ns]

    def close(self) -> None:
        """Draw no further."""
        for picture in (*self._shown.values(), *self._under_way):
            picture.end()
