"""Draw the moving picture of the README from the recording of a run of the store.

    stepbus run store --out runs/store && python store/scripts/store_movie.py runs/store/run.mcap

Nothing is simulated again: the plant's engine draws the world of the recording with the robot and
every item where they stood. Needs `make robots`.
"""

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image
from store_pictures import FOLDER, LIGHT, Log, Look, Moments, Picture, Scene

from stepbus import Event
from stepbus.messages import BaseState

SIZE = (640, 360)
"""Width and height of a frame [pixel]."""
FRAME_MS = 80
SKY = (238, 242, 247)
INK = (52, 58, 70)
LIT_FLOOR = 138.0
"""Grey of the floor in the light, as the world has it; a shadow is a few values darker."""
FLOOR = np.array([212.0, 216.0, 222.0])
"""Red, green, blue of the floor in the light, as drawn: lighter, with deeper shadows."""
SUN = dataclasses.replace(LIGHT, distance=20.0, ambient=0.62, diffuse=0.42, has_shadow=True)
_FLAT = 3e-3
"""What is no higher is the floor [m]."""


class Shot(NamedTuple):
    """A stretch of the run, from one point of view.

    start, end: steps. speed: simulated seconds in a second of the film.
    """

    caption: str
    start: int
    end: int
    speed: float
    look: Look


WIDE = Look((1.0, 0.1, 0.33), 4.1, 52.0, 22.0, 28.0)
SHELF = Look((1.95, 0.0, 0.42), 2.5, 52.0, 24.0, 34.0)
OUTLET = Look((0.45, 0.15, 0.30), 3.5, -40.0, 23.0, 32.0)


def shots(log: Log, when: Moments) -> Sequence[Shot]:
    """Return the film: drive, find and grasp, carry, place."""
    arrived = _still(log, when.start, when.found)
    events = [(s, m) for s, m in log.messages("mission/events") if isinstance(m, Event)]
    lifted = next(step for step, event in events if ": lifted" in event.text)
    home = _still(log, lifted, when.placed)
    end = log["plant/joint_state"].last_step
    return (
        Shot("drive to the shelf", when.start, arrived, 3.0, WIDE),
        Shot("find the can, grasp it", arrived, lifted, 4.0, SHELF),
        Shot("carry it back", lifted, home, 3.0, OUTLET),
        Shot("place it in the outlet", home, end, 3.0, OUTLET),
    )


def _still(log: Log, start: int, end: int) -> int:
    """Return the step from which the base no longer moves before `end`."""
    states = [(s, m) for s, m in log.messages("plant/odometry") if isinstance(m, BaseState)]
    return max(s for s, m in states if start <= s <= end and abs(m.vx) + abs(m.wz) > 0.02)


def frames(log: Log, scene: Scene, film: Sequence[Shot], step_s: float) -> Iterator[Picture]:
    """Yield the frames of a film, each FRAME_MS long."""
    for shot in film:
        every = max(1, round(shot.speed * FRAME_MS / 1000 / step_s))
        for step in range(shot.start, shot.end, every):
            scene.show(step)
            text = f"{shot.caption}   {log.time_ns(step) * 1e-9:4.1f} s   x{shot.speed:.0f}"
            yield captioned(draw(scene, shot.look), text)


def draw(scene: Scene, look: Look) -> Picture:
    """Return what is seen, with a plain sky, drawn in twice the size first."""
    picture, height = scene.render(look, 2 * SIZE[0], 2 * SIZE[1], SUN)
    floor = np.abs(height) < _FLAT
    picture[floor] = np.clip(FLOOR + 3.0 * (picture[floor] - LIT_FLOOR), 150, 255)
    picture[np.isinf(height)] = SKY
    return np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def captioned(picture: Picture, text: str) -> Picture:
    """Draw a caption into the lower edge of a picture and return it."""
    cv2.rectangle(picture, (0, SIZE[1] - 30), SIZE, INK, -1)
    at = (14, SIZE[1] - 10)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, SKY, 1, cv2.LINE_AA)
    return picture


def write(path: Path, film: Sequence[Picture]) -> None:
    """Write a GIF with one palette for all frames, so that what stands still costs nothing."""
    sample = np.concatenate([frame[::2, ::2] for frame in film[:: max(1, len(film) // 12)]])
    palette = Image.fromarray(sample).quantize(96, method=Image.Quantize.MEDIANCUT)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in film
    ]
    durations = [FRAME_MS] * (len(images) - 1) + [1600]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=False
    )


def main() -> int:
    """Write the film."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="recording (run.mcap) of a run of the store")
    parser.add_argument("--out", type=Path, default=FOLDER / "store.gif")
    args = parser.parse_args()
    log = Log(args.recording)
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(log, Path(folder))
        film = list(frames(log, scene, shots(log, log.moments()), log.time_ns(1) * 1e-9))
    write(args.out, film)
    sys.stdout.write(f"{args.out}  {len(film)} frames, {args.out.stat().st_size // 1024} kB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
