"""A recording as MP4 or GIF: what its camera saw, or its scene from a viewpoint."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.run.result import result_beside
from stepbus_participant import need, parse_duration
from stepbus_schemas import Image, StepbusError, WiringError
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.theme import PAPER
from stepbus_tools.viewing.exports.exporter import NS, Exported, Rate, Reached
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.rasteriser import Painter, Pixels, pixels_of
from stepbus_tools.viewing.scene.build import drawn_scene
from stepbus_tools.viewing.viewpoint import parse_viewpoint, swept
from stepbus_tools.whole_file import replaced

_FRAMES_PER_S = 25.0
_MOST_FRAMES_PER_S = 120.0
_SIZE = (640, 480)
_SIZES = (16, 4096)
"""The smallest and the largest width or height [pixels]."""
_MOST_GIF_FRAMES = 750
_GIF_TICK_NS = 10_000_000
"""A GIF counts in hundredths of a second [ns]."""
_SHORTEST_GIF_NS = 40_000_000
"""Viewers slow down what is faster [ns]."""
_RARE_NS = 1_000_000_000
"""Images that are farther apart on the average make no film [ns]."""
_TICK = Fraction(1, 90_000)
"""The unit of times in an MP4 [s]; whole ones between the frames at any usual rate."""
_READABLE = (160, 90)
"""Smaller frames have no room for words [pixels]."""
_LAST_NS = 50_000_000
"""How near to the end of a run the last frame of a film is."""

Shot = tuple[int, Pixels]
"""Simulation time [ns] and picture, shape (height, width, 3)."""


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """What of a recording is shown, and how. size: (width, height), None: of the camera.

    fps: frames a second; None: each image of the camera. start_ns, end_ns: simulation time [ns].
    """

    size: tuple[int, int] | None
    fps: float | None
    start_ns: int
    end_ns: int

    def times(self) -> list[int]:
        """Return the time of each frame [ns]."""
        rate = Fraction(str(self.fps or _FRAMES_PER_S))
        count = math.floor((self.end_ns - self.start_ns) * rate / NS)
        return [self.start_ns + round(number * NS / rate) for number in range(count + 1)]


def write(
    recording: Recording,
    target: Path,
    reached: Reached,
    *,
    camera: str = "",
    viewpoint: str = "",
    size: str = "",
    fps: str = "",
    from_: str = "",
    to: str = "",
) -> Exported:
    """Write a film of a recording; target: ends in .mp4 or .gif.

    camera: a port of images; empty: the first that takes one a second or more. viewpoint: draws the
    scene instead. Without such a camera and a viewpoint, the scene is drawn from a corner. size:
    such as 1280x720. fps: frames a second. from_, to: durations of simulation. Raises
    RecordingFailed when there is nothing to show, WiringError for another ending, or an option that
    does not fit.
    """
    if target.suffix not in _WRITERS:
        raise WiringError(f"{target} is not a video file: write .mp4 or .gif")
    history, problems = History(recording), list[str]()
    plan = _plan(history, size, fps, from_, to)
    port = None if viewpoint else _camera(recording, camera)
    if port is None:
        shots = _drawn(history, viewpoint or "corner", plan)
    else:
        shots = _seen(port, plan, problems)
    with replaced(target) as path:
        try:
            written = _captioned(history, shots, reached)
            problems += _WRITERS[target.suffix](path, written, plan)
        except ValueError as exc:
            raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    return Exported(paths=[target], problems=problems)


def _plan(history: History, size: str, fps: str, start: str, end: str) -> _Plan:
    """Return what the options ask for; raises WiringError where they do not fit."""
    start_ns, end_ns = _time(start, 0), min(_time(end, history.end_ns), history.end_ns)
    try:
        rate = float(fps) if fps else None
    except ValueError:
        rate = math.nan
    if rate is not None and not 0 < rate <= _MOST_FRAMES_PER_S:
        most = f"{_MOST_FRAMES_PER_S:g}"
        raise WiringError(f"--fps {fps}: must be more than 0 and at most {most} frames per second")
    return _Plan(size=_size(size), fps=rate, start_ns=start_ns, end_ns=end_ns)


def _time(text: str, default: int) -> int:
    """Return a simulation time [ns]."""
    if not text:
        return default
    return 0 if text.strip() == "0" else parse_duration(text, may_be_zero=True)


def _size(text: str) -> tuple[int, int] | None:
    if not text:
        return None
    words = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text.strip())
    width, height = (int(word) for word in words.groups()) if words else (0, 0)
    least, most = _SIZES
    if not (least <= width <= most and least <= height <= most):
        raise WiringError(
            f"--size {text}: write width and height in pixels, {least} to {most}, such as 1280x720"
        )
    return width, height


def _camera(recording: Recording, name: str) -> Port | None:
    """Return the port whose images are shown; None: the scene is drawn."""
    if not name:
        return next(filter(_films, recording.of_type("Image/1")), None)
    port = recording[name]
    if port.type != "Image/1":
        raise WiringError(f"{name} is {port.type}, not a camera")
    if port.last_step < 0:
        raise RecordingFailed(f"{port.topic} of {recording.path} has no image")
    return port


def _films(camera: Port) -> bool:
    """Return whether a camera has images, and takes them often enough to show what happens."""
    times = camera.t_ns
    return len(times) > 0 and times[-1] - times[0] <= _RARE_NS * max(len(times) - 1, 1)


def _seen(camera: Port, plan: _Plan, problems: list[str]) -> Iterator[Shot]:
    """Yield what a camera saw; with a rate, at most so many images a second."""
    rate = Rate(plan.fps or math.inf)
    try:
        for (_, message), t_ns in zip(camera.messages(), camera.t_ns.tolist(), strict=False):
            if t_ns > plan.end_ns:
                return
            if t_ns < plan.start_ns or not isinstance(message, Image) or not message.width:
                continue
            if rate.passes(camera.topic, t_ns):
                yield t_ns, _sized(pixels_of(message), plan.size)
    except StepbusError as exc:
        problems.append(str(exc))


def _sized(pixels: Pixels, size: tuple[int, int] | None) -> Pixels:
    """Return a picture in a size; what its shape leaves free is paper."""
    if size is None or pixels.shape[:2] == size[::-1]:
        return pixels
    images, ops = need("--size", "PIL.Image", "PIL.ImageOps")
    whole = images.fromarray(np.ascontiguousarray(pixels))
    return np.asarray(ops.pad(whole, size, color=PAPER["raised"]))


def _drawn(history: History, viewpoint: str, plan: _Plan) -> Iterator[Shot]:
    scene = drawn_scene(history.recording)
    width, height = plan.size or _SIZE
    shown = swept(scene, history, plan.start_ns, plan.end_ns)
    view = parse_viewpoint(viewpoint, shown.box, width / height, shown.fixed)
    painter = Painter(scene, (width, height), smooth=True, floor=shown.box)
    for t_ns in plan.times():
        yield t_ns, painter.draw(history.at(scene.topics, t_ns), view)


def _captioned(history: History, shots: Iterator[Shot], reached: Reached) -> Iterator[Shot]:
    """Yield frames with the time and the scenario on them, and at the end how the run ended."""
    images, drawing, fonts = need("text in a video", "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont")
    name, result = scenario_name(history.recording), result_beside(history.recording)
    ending = f"   {result.outcome} {result.cause}" if result else ""
    for t_ns, pixels in shots:
        height, width, _ = pixels.shape
        frame = images.fromarray(np.ascontiguousarray(pixels))
        if width >= _READABLE[0] and height >= _READABLE[1]:
            size = max(11, height // 28)
            has_ended = t_ns >= history.end_ns - _LAST_NS
            drawing.Draw(frame).text(
                (size, height - size),
                f"{t_ns * 1e-9:.2f} s   {name}{ending if has_ended else ''}".rstrip(),
                fill=PAPER["ink"],
                font=fonts.load_default(size),
                anchor="ls",
                stroke_width=2,
                stroke_fill=PAPER["paper"],
            )
        yield t_ns, np.asarray(frame)
        reached(t_ns // history.step_ns)


def _write_mp4(path: Path, shots: Iterator[Shot], plan: _Plan) -> list[str]:
    (av,) = need("a video", "av")
    with av.open(str(path), "w", format="mp4") as container:
        stream: Any = None
        newest = -1
        for t_ns, pixels in shots:
            even = _even(pixels)
            if stream is None:
                rate = Fraction(plan.fps or _FRAMES_PER_S).limit_denominator(1000)
                stream = container.add_stream("libx264", rate=rate)
                stream.height, stream.width = even.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.codec_context.time_base = _TICK
                stream.options = {"crf": "20", "preset": "veryfast"}
            tick = round(Fraction(t_ns - plan.start_ns, NS) / _TICK)
            if tick <= newest or even.shape[:2] != (stream.height, stream.width):
                continue
            frame = av.VideoFrame.from_ndarray(even, format="rgb24")
            frame.pts, frame.time_base, newest = tick, _TICK, tick
            container.mux(stream.encode(frame))
        if stream is None:
            raise ValueError("no image in this time range")
        container.mux(stream.encode())
    return []


def _even(pixels: Pixels) -> Pixels:
    """Return a picture of even width and height, which H.264 needs; an edge is repeated."""
    height, width, _ = pixels.shape
    padded: Pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return np.ascontiguousarray(padded)


def _write_gif(path: Path, shots: Iterator[Shot], _plan: _Plan) -> list[str]:
    (pillow,) = need("a GIF", "PIL.Image")
    frames: list[Any] = []
    times: list[int] = []
    for t_ns, pixels in shots:
        if len(frames) == _MOST_GIF_FRAMES:
            break
        if not times or t_ns - times[-1] >= _SHORTEST_GIF_NS:
            frames.append(pillow.fromarray(np.ascontiguousarray(pixels)).quantize(128))
            times.append(t_ns)
    if not frames:
        raise ValueError("no image in this time range")
    # Round times, not the intervals between them: their errors would add up.
    ends = [round((t_ns - times[0]) / _GIF_TICK_NS) for t_ns in times]
    lasts = [10 * (b - a) for a, b in pairwise(ends)] + [500]
    frames[0].save(
        path, "GIF", save_all=True, append_images=frames[1:], duration=lasts, loop=0, optimize=True
    )
    if len(frames) == _MOST_GIF_FRAMES:
        return [f"{path.name.strip('.')} ends after {times[-1] * 1e-9:g} s; write .mp4 for all"]
    return []


_WRITERS: Mapping[str, Callable[[Path, Iterator[Shot], _Plan], list[str]]] = {
    ".mp4": _write_mp4,
    ".gif": _write_gif,
}
