"""A recording as MP4 or GIF: what its camera saw, or its scene from a viewpoint."""

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_participant import need
from stepbus_schemas import Image, StepbusError, WiringError
from stepbus_tools.viewing.exports.exporter import Exported, Exporter, Reached
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Painter, Pixels, parse_viewpoint, pixels_of
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.whole_file import replaced

_FRAMES_PER_S = 25
_SIZE = (640, 480)
_MOST_GIF_FRAMES = 750
_SHORTEST_GIF_MS = 40
_RARE_NS = 1_000_000_000
"""Images that are farther apart on the average make no film [ns]."""
"""A GIF counts in hundredths of a second, and viewers slow down what is faster."""
_MS = Fraction(1, 1000)
_VIEWPOINT_HELP = (
    "with --video: draw the scene from corner, front, left, right, above, or from "
    "X,Y,Z[:X,Y,Z] [m]: the eye, and what it looks at"
)

Shot = tuple[int, Pixels]
"""Time [ms] and picture, shape (height, width, 3)."""


def _export(
    recording: Recording, target: Path, reached: Reached, *, camera: str = "", viewpoint: str = ""
) -> Exported:
    """Write a film of a recording; target: ends in .mp4 or .gif.

    camera: a port of images; empty: the first that takes one a second or more. viewpoint: draws the
    scene instead. Without such a camera and a viewpoint, the scene is drawn from a corner. Raises
    RecordingFailed when there is nothing to show, WiringError for another ending, camera or
    viewpoint.
    """
    if target.suffix not in _WRITERS:
        raise WiringError(f"{target} is no film: write .mp4 or .gif")
    problems: list[str] = []
    port = None if viewpoint else _camera(recording, camera)
    if port is None:
        shots = _drawn(recording, viewpoint or "corner", reached)
    else:
        shots = _seen(port, reached, problems)
    with replaced(target) as path:
        try:
            problems += _WRITERS[target.suffix](path, shots)
        except ValueError as exc:
            raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    return Exported(paths=[target], problems=problems)


VIDEO = Exporter(
    write=_export,
    help=".mp4 or .gif of the recorded camera, or of the scene where there is none",
    options={
        "camera": ("PORT", "with --video: a port of images; default: the first with one a second"),
        "viewpoint": ("FROM", _VIEWPOINT_HELP),
    },
)


def _camera(recording: Recording, name: str) -> Port | None:
    """Return the port whose images are shown; None: the scene is drawn."""
    if not name:
        return next(filter(_films, recording.of_type("Image/1")), None)
    port = recording[name]
    if port.type != "Image/1":
        raise WiringError(f"{name} is {port.type}, no camera")
    if port.last_step < 0:
        raise RecordingFailed(f"{port.topic} of {recording.path} has no image")
    return port


def _films(camera: Port) -> bool:
    """Return whether a camera has images, and takes them often enough to show what happens."""
    times = camera.t_ns
    return len(times) > 0 and times[-1] - times[0] <= _RARE_NS * max(len(times) - 1, 1)


def _seen(camera: Port, reached: Reached, problems: list[str]) -> Iterator[Shot]:
    try:
        for (step, message), t_ns in zip(camera.messages(), camera.t_ns, strict=False):
            if isinstance(message, Image) and message.width:
                reached(step)
                yield round(t_ns * 1e-6), pixels_of(message)
    except StepbusError as exc:
        problems.append(str(exc))


def _drawn(recording: Recording, viewpoint: str, reached: Reached) -> Iterator[Shot]:
    scene, history = build_scene(recording), History(recording)
    if history.last_step < 0 or not scene.has_looks:
        why = scene.notes[-1] if scene.notes else "it has no messages"
        raise RecordingFailed(f"{recording.path} has no scene to show: {why}")
    view = parse_viewpoint(viewpoint, scene, history.at(scene.topics, 0))
    painter = Painter(scene, _SIZE)
    times = history.times(max(1, round(history.end_ns * 1e-9 * _FRAMES_PER_S)))
    for number, t_ns in enumerate(times):
        yield t_ns // 1_000_000, painter.draw(history.at(scene.topics, t_ns), view)
        reached(history.last_step * number // (len(times) - 1))


def _write_mp4(path: Path, shots: Iterator[Shot]) -> list[str]:
    (av,) = need("a video", "av")
    with av.open(str(path), "w", format="mp4") as container:
        stream: Any = None
        newest = -1
        for t_ms, pixels in shots:
            even = _even(pixels)
            if stream is None:
                stream = container.add_stream("libx264", rate=_FRAMES_PER_S)
                stream.height, stream.width = even.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.codec_context.time_base = _MS
                stream.options = {"crf": "20", "preset": "veryfast"}
            if t_ms <= newest or even.shape[:2] != (stream.height, stream.width):
                continue
            frame = av.VideoFrame.from_ndarray(even, format="rgb24")
            frame.pts, frame.time_base, newest = t_ms, _MS, t_ms
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())
    return []


def _even(pixels: Pixels) -> Pixels:
    """Return a picture of even width and height, which H.264 needs; an edge is repeated."""
    height, width, _ = pixels.shape
    padded: Pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return np.ascontiguousarray(padded)


def _write_gif(path: Path, shots: Iterator[Shot]) -> list[str]:
    (pillow,) = need("a GIF", "PIL.Image")
    frames: list[Any] = []
    times: list[int] = []
    for t_ms, pixels in shots:
        if len(frames) == _MOST_GIF_FRAMES:
            break
        if not times or t_ms - times[-1] >= _SHORTEST_GIF_MS:
            frames.append(pillow.fromarray(np.ascontiguousarray(pixels)).quantize(128))
            times.append(t_ms)
    lasts = [b - a for a, b in pairwise(times)] + [500]
    frames[0].save(
        path, "GIF", save_all=True, append_images=frames[1:], duration=lasts, loop=0, optimize=True
    )
    if len(frames) == _MOST_GIF_FRAMES:
        return [f"{path.name.strip('.')} ends after {times[-1] * 1e-3:g} s; write .mp4 for all"]
    return []


_WRITERS: Mapping[str, Callable[[Path, Iterator[Shot]], list[str]]] = {
    ".mp4": _write_mp4,
    ".gif": _write_gif,
}
