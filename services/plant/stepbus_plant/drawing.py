"""Draws what cameras see: beside the steps, and beside each other.

A picture is drawn in a copy of the process, which has the world as it is when the picture is taken:
so its pixels are those that the plant itself would draw, whatever engine it uses. What is drawn
where is decided by what it takes, and changes no result.
"""

import contextlib
import os
from collections import deque
from collections.abc import Collection
from functools import cached_property, partial
from itertools import chain
from time import perf_counter

from stepbus_participant.beside import Copy
from stepbus_plant.camera import Camera, Rendering

_WORTH_S = 0.01
"""What a picture has to take for a copy to be faster, which takes 2 ms, and 8 of another core."""


class _Picture:
    """A picture that a camera takes now.

    due_ns: when it is put out [ns]. cores: a copy may run on; none: it is drawn here, when it is
    asked for.
    """

    def __init__(self, camera: Camera, t_ns: int, cores: Collection[int]) -> None:
        self.due_ns = t_ns + camera.latency_ns
        self._camera, self._t_ns = camera, t_ns
        self._copy: Copy | None = None
        if cores:
            what = f"camera {camera.name!r}, image of {t_ns / 1e9:g} s"
            # Where there can be no further process, it is drawn here.
            with contextlib.suppress(OSError):
                self._copy = Copy(partial(camera.pixels, t_ns), camera.size, what, cores)

    @property
    def is_beside(self) -> bool:
        """Return whether it is drawn in a copy."""
        return self._copy is not None

    @cached_property
    def rendering(self) -> Rendering:
        """Colours and depth; raises RunError where its copy has failed."""
        if self._copy is None:
            return self._camera.render(self._t_ns)
        return self._camera.rendering(self._copy.result())

    def end(self) -> None:
        """Draw no further."""
        if self._copy is not None:
            self._copy.end()


class Drawing:
    """Takes and draws the pictures of those cameras that outputs show."""

    def __init__(self) -> None:
        # As the process is started: while it runs, it may be kept on one of them.
        cores = os.sched_getaffinity(0)
        self._cores: Collection[int] = cores if len(cores) > 1 else ()
        self._t_ns = -1
        self._cameras: list[Camera] = []
        self._took_s: dict[str, float] = {}
        self._under_way: dict[str, deque[_Picture]] = {}
        self._shown: dict[str, _Picture] = {}

    @property
    def has_cameras(self) -> bool:
        """Return whether it draws anything."""
        return bool(self._cameras)

    def add(self, camera: Camera) -> None:
        """Draw the pictures of one more camera, once."""
        if camera not in self._cameras:
            self._cameras.append(camera)
            self._under_way[camera.name] = deque()

    def images(self, camera: Camera, t_ns: int) -> Rendering | None:
        """Return what a camera puts out at a time [ns], drawn once for all ports; None: nothing."""
        if t_ns != self._t_ns:
            self._take(t_ns)
        picture = self._shown.get(camera.name)
        if picture is None:
            return None
        began = perf_counter()
        rendering = picture.rendering
        if not picture.is_beside:
            self._took_s.setdefault(camera.name, perf_counter() - began)
        return rendering

    def _take(self, t_ns: int) -> None:
        """Take the pictures of a time; those that are shown now are drawn at once."""
        self._t_ns = t_ns
        taking = [camera for camera in self._cameras if camera.takes(t_ns)]
        now = [camera for camera in taking if not camera.latency_ns]
        # This process draws the last of them itself.
        slow = [camera for camera in now if self._took_s.get(camera.name, 0.0) > _WORTH_S][:-1]
        for camera in taking:
            is_beside = bool(camera.latency_ns) or camera in slow
            picture = _Picture(camera, t_ns, self._cores if is_beside else ())
            if camera.latency_ns and not picture.is_beside:
                _ = picture.rendering
            self._under_way[camera.name].append(picture)
        self._shown = {
            name: pictures.popleft()
            for name, pictures in self._under_way.items()
            if pictures and pictures[0].due_ns == t_ns
        }

    def close(self) -> None:
        """Draw no further."""
        for picture in chain(self._shown.values(), *self._under_way.values()):
            picture.end()
