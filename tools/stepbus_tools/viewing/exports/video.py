"""A recording as MP4 or GIF: what its camera saw, or its scene from a viewpoint."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_participant import need
from stepbus_schemas import Image, StepbusError, WiringError
from stepbus_tools.viewing.exports.export_files import Exported, Reached
from stepbus_tools.viewing.render import Painter, Pixels, parse_viewpoint, pixels_of
from stepbus_tools.viewing.scene import build_scene
from stepbus_tools.viewing.scene_file import latest_messages
from stepbus_tools.whole_file import replaced

FRAMES_PER_S = 25
SIZE = (640, 480)
_MOST_GIF_FRAMES = 750
_MS = Fraction(1, 1000)

Shot = tuple[int, Pixels]
"""Time [ms] and picture, shape (height, width, 3)."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """What to show. camera: a port of images; empty: the first. viewpoint: draws the scene instead.

    size: of what is drawn, (width, height).
    """

    camera: str = ""
    viewpoint: str = ""
    size: tuple[int, int] = SIZE


def export_video(film: Film, recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write a film of a recording; target: ends in .mp4 or .gif.

    Without a camera in the recording, and without a viewpoint, the scene is drawn from a corner.
    Raises RecordingFailed when there is nothing to show or the file cannot be written, WiringError
    for another ending, camera or viewpoint, ExtraMissing without the library.
    """
    writers: dict[str, Callable[[Path, Iterator[Shot]], list[str]]] = {
        ".mp4": _write_mp4,
        ".gif": _write_gif,
    }
    if target.suffix not in writers:
        raise WiringError(f"{target} is no film: write .mp4 or .gif")
    problems: list[str] = []
    shots = _shots(film, recording, reached, problems)
    with replaced(target) as path:
        try:
            problems += writers[target.suffix](path, shots)
        except ValueError as exc:
            raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    return Exported(paths=[target], problems=problems)


def _shots(
    film: Film, recording: Recording, reached: Reached, problems: list[str]
) -> Iterator[Shot]:
    camera = _camera(film, recording)
    if camera is None:
        return _drawn(film, recording, reached)
    if camera.last_step < 0:
        raise RecordingFailed(f"{camera.topic} of {recording.path} has no image")
    return _seen(camera, reached, problems)


def _camera(film: Film, recording: Recording) -> Port | None:
    """Return the port whose images are shown; None: the scene is drawn."""
    if film.viewpoint:
        return None
    if film.camera:
        port = recording[film.camera]
        if port.type != "Image/1":
            raise WiringError(f"{film.camera} is {port.type}, no camera")
        return port
    return next((port for port in recording.of_type("Image/1") if port.last_step >= 0), None)


def _seen(camera: Port, reached: Reached, problems: list[str]) -> Iterator[Shot]:
    try:
        for (step, message), t in zip(camera.messages(), camera.t, strict=False):
            if isinstance(message, Image) and message.width:
                reached(step)
                yield round(float(t) * 1e3), pixels_of(message)
    except StepbusError as exc:
        problems.append(str(exc))


def _drawn(film: Film, recording: Recording, reached: Reached) -> Iterator[Shot]:
    scene = build_scene(recording.path, recording.ports, recording.attachments)
    rows = [row for port in recording.ports.values() if (row := port.last)]
    if not rows or not any(frame.visuals for frame in scene.frames):
        why = scene.notes[-1] if scene.notes else "it has no messages"
        raise RecordingFailed(f"{recording.path} has no scene to show: {why}")
    end_ns, last = max(row.t_ns for row in rows), max(row.step for row in rows)
    first = latest_messages(recording, scene, 0)
    view = parse_viewpoint(film.viewpoint or "corner", scene, first)
    painter = Painter(scene, film.size)
    count = max(1, round(end_ns * 1e-9 * FRAMES_PER_S))
    for number in range(count + 1):
        t_ns = end_ns * number // count
        yield t_ns // 1_000_000, painter.draw(latest_messages(recording, scene, t_ns), view)
        reached(last * number // count)


def _write_mp4(path: Path, shots: Iterator[Shot]) -> list[str]:
    (av,) = need("a video", "av")
    with av.open(str(path), "w", format="mp4") as container:
        stream: Any = None
        newest = -1
        for t_ms, pixels in shots:
            even = _even(pixels)
            if stream is None:
                stream = container.add_stream("libx264", rate=FRAMES_PER_S)
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
        # A GIF counts in hundredths of a second.
        if not times or t_ms - times[-1] >= 40:
            frames.append(pillow.fromarray(np.ascontiguousarray(pixels)).quantize(128))
            times.append(t_ms)
    lasts = [b - a for a, b in pairwise(times)] + [500]
    frames[0].save(
        path, "GIF", save_all=True, append_images=frames[1:], duration=lasts, loop=0, optimize=True
    )
    if len(frames) == _MOST_GIF_FRAMES:
        return [f"{path.name.strip('.')} ends after {times[-1] * 1e-3:g} s; write .mp4 for all"]
    return []
