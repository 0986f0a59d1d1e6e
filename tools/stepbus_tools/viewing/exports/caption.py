"""The strip on the frames of a film: whose run it is, how it ended, and its time."""

import numpy as np

from stepbus_orchestrator.run.result import result_beside
from stepbus_participant import need
from stepbus_tools.look import PAPER
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Pixels

_SMALLEST = (160, 90)
"""Smaller frames have no room for words [pixels]."""
_VEIL = 225
"""How much the strip hides of the picture, of 255."""
_LAST_NS = 50_000_000
"""How near to the end of a run the last frame of a film is."""


class Caption:
    """A strip at the lower edge: the scenario, at the end its outcome, and the simulation time.

    size: (width, height) of the frames. Raises ExtraMissing without Pillow.
    """

    def __init__(self, history: History, size: tuple[int, int]) -> None:
        self._images, self._drawing, fonts = need(
            "text in a video", "PIL.Image", "PIL.ImageDraw", "PIL.ImageFont"
        )
        (self._width, height), (least, lowest) = size, _SMALLEST
        has_room = self._width >= least and height >= lowest
        self._height = max(20, round(height / 16)) if has_room else 0
        self._font = fonts.load_default(max(11, round(0.56 * self._height)))
        self._end_ns = history.end_ns
        self._words = [(scenario_name(history.recording), PAPER["ink"])]
        self._outcome: list[tuple[str, str]] = []
        if (result := result_beside(history.recording)) is not None:
            color = PAPER["bad" if result.exit_code else "good"]
            reason = (result.cause or result.reason) if result.exit_code else ""
            self._outcome = [(result.outcome, color), (reason, PAPER["soft"])]

    def on(self, pixels: Pixels, t_ns: int) -> Pixels:
        """Return a frame with the caption and its time [ns] on it."""
        if not self._height:
            return pixels
        strip = self._images.new("RGB", (self._width, self._height), PAPER["paper"])
        pen, gap, middle = self._drawing.Draw(strip), 0.6 * self._height, self._height / 2
        pen.line([(0, 0), (self._width, 0)], fill=PAPER["line"])
        x, has_ended = gap, t_ns >= self._end_ns - _LAST_NS
        for text, color in [*self._words, *(self._outcome if has_ended else ())]:
            pen.text((x, middle), text, fill=color, font=self._font, anchor="lm")
            x += self._font.getlength(text) + gap
        # From the left, in room for any digits: the clock hides long words, and does not jump.
        clock = f"{t_ns * 1e-9:.2f} s"
        left = self._width - gap - self._font.getlength("0" * len(clock))
        pen.rectangle([(left - gap, 1), (self._width, self._height)], fill=PAPER["paper"])
        pen.text((left, middle), clock, fill=PAPER["ink"], font=self._font, anchor="lm")
        framed = np.array(pixels)
        below = self._images.fromarray(framed[-self._height :])
        framed[-self._height :] = np.asarray(self._images.blend(below, strip, _VEIL / 255))
        return framed
