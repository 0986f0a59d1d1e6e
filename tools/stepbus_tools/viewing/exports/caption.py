"""What is written on the frames of a film: whose run it is, how it ended, and its time."""

from typing import Any

import numpy as np

from stepbus_orchestrator.run.result import Result, result_beside
from stepbus_participant import need
from stepbus_tools.look import PAPER
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Pixels

_SMALLEST = (160, 90)
"""Smaller frames have no room for words [pixels]."""
_VEIL = 225
"""How much the strip hides of the picture, of 255."""
_NS = 1e-9

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
        width, height = size
        self._height = max(20, round(height / 16)) if width >= _SMALLEST[0] else 0
        self._height = self._height if height >= _SMALLEST[1] else 0
        self._font = fonts.load_default(max(11, round(0.56 * self._height)))
        self._digit = max(self._font.getlength(digit) for digit in "0123456789")
        self._strip: Any = self._images.new("RGB", (width, max(1, self._height)), PAPER["paper"])
        self._last: Any = self._strip.copy()
        self._end_ns = history.end_ns
        if self._height:
            name = scenario_name(history.recording)
            self._write(self._strip, name, None)
            self._write(self._last, name, result_beside(history.recording))

    def _write(self, strip: Any, name: str, result: Result | None) -> None:
        """Write the words that do not change. result: of a run that has ended."""
        words, width = [(name, PAPER["ink"])], strip.width
        if result is not None:
            color = PAPER["good" if result.exit_code == 0 else "bad"]
            words.append((result.outcome, color))
            if result.exit_code:
                words.append((result.cause or result.reason, PAPER["soft"]))
        pen = self._drawing.Draw(strip)
        pen.line([(0, 0), (width, 0)], fill=PAPER["line"])
        # Room for the clock is left at the right.
        gap, end = 0.6 * self._height, width - 9 * self._digit
        x = gap
        for text, color in words:
            shown = self._cut(text, end - x)
            pen.text((x, self._height / 2), shown, fill=color, font=self._font, anchor="lm")
            x += self._font.getlength(shown) + gap

    def _cut(self, text: str, room: float) -> str:
        """Return as much of a text as there is room for."""
        if self._font.getlength(text) <= room:
            return text
        while text and self._font.getlength(f"{text}…") > room:
            text = text[:-1]
        return f"{text.rstrip()}…" if text else ""

    def on(self, pixels: Pixels, t_ns: int) -> Pixels:
        """Return a frame with the caption and its time [ns] on it."""
        if not self._height:
            return pixels
        strip = (self._strip if t_ns < self._end_ns - _LAST_NS else self._last).copy()
        pen = self._drawing.Draw(strip)
        x = strip.width - 0.6 * self._height
        # From the right, each digit in as much room as the others: they do not jump.
        for letter in reversed(f"{t_ns * _NS:.2f} s"):
            room = self._digit if letter.isdigit() else self._font.getlength(letter)
            place = (x - room / 2, self._height / 2)
            pen.text(place, letter, fill=PAPER["ink"], font=self._font, anchor="mm")
            x -= room
        framed = np.array(pixels)
        below = self._images.fromarray(framed[-self._height :])
        framed[-self._height :] = np.asarray(self._images.blend(below, strip, _VEIL / 255))
        return framed
