"""All exports of a recording: `stepbus export` and `stepbus.export`."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_tools.viewing.exports.export_files import Exported, Reached

from .tables import export_tables

Export = Callable[[Recording, Path, Reached], Exported]
Progress = Callable[[str, int], AbstractContextManager[Reached]]
"""Shows how far an export has come. It takes its form, and the last step."""


def export(
    recording: Recording,
    targets: Mapping[str, Path],
    *,
    camera: str = "",
    viewpoint: str = "",
    progress: Progress | None = None,
) -> Iterator[tuple[str, Exported]]:
    """Write a recording in several forms, and yield each with what was written.

    targets: form → path; `parquet`, `csv`, `scene`, `ros2`, `foxglove` or `video`. camera,
    viewpoint: of a video, as of `Film`. Raises RecordingFailed when there is nothing to export or
    a file cannot be written, WiringError for another camera, viewpoint or ending, ExtraMissing
    without the library of a form.
    """
    for form, target in targets.items():
        write = _WRITERS.get(form) or partial(_video, camera, viewpoint)
        with (progress or _silent)(form, recording.last_step) as reached:
            done = write(recording, target, reached)
        yield form, done


def damage_line(recording: Recording) -> str:
    """Return why an export of a recording ends before its run; empty for a whole one."""
    if not recording.cut_short:
        return ""
    return f"{recording.path} {recording.cut_short}; exported up to step {recording.last_step}"


def _silent(_form: str, _last_step: int) -> AbstractContextManager[Reached]:
    return nullcontext(lambda _step: None)


# Each loads libraries of its own.


def _parquet(recording: Recording, target: Path, reached: Reached) -> Exported:
    return export_tables(recording, target, "parquet", reached)


def _csv(recording: Recording, target: Path, reached: Reached) -> Exported:
    return export_tables(recording, target, "csv", reached)


def _scene(recording: Recording, target: Path, reached: Reached) -> Exported:
    from stepbus_tools.viewing.scene_file import export_scene  # noqa: PLC0415  (viser)

    return export_scene(recording, target, reached)


def _ros2(recording: Recording, target: Path, reached: Reached) -> Exported:
    from .ros2 import export_ros2  # noqa: PLC0415  (as above)

    return export_ros2(recording, target, reached)


def _foxglove(recording: Recording, target: Path, reached: Reached) -> Exported:
    from .foxglove import export_foxglove  # noqa: PLC0415  (as above)

    return export_foxglove(recording, target, reached)


def _video(
    camera: str, viewpoint: str, recording: Recording, target: Path, reached: Reached
) -> Exported:
    from .video import Film, export_video  # noqa: PLC0415  (as above)

    return export_video(Film(camera=camera, viewpoint=viewpoint), recording, target, reached)


_WRITERS: Mapping[str, Export] = {
    "parquet": _parquet,
    "csv": _csv,
    "scene": _scene,
    "ros2": _ros2,
    "foxglove": _foxglove,
}
FORMS = (*_WRITERS, "video")
"""What a recording can be exported to, in the order in which it is."""
