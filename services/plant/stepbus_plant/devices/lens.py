"""What a real camera makes of a scene: a lamp, blur, and noise of colour and depth."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_plant.params import CameraErrors

from .sensors.noise import Noise

_WHITE = (1.0, 1.0, 1.0)
# Matt surfaces under white light from above: each colour is 0.6 to 1.0 times that of its visual.
_EVEN = {
    "shadow": 0,
    "lightDirection": (0.3, 0.2, 1.0),
    "lightColor": _WHITE,
    "lightDistance": 2.0,
    "lightAmbientCoeff": 0.6,
    "lightDiffuseCoeff": 0.4,
    "lightSpecularCoeff": 0.0,
}
_LAMP = {
    "shadow": 1,
    "lightColor": _WHITE,
    "lightDistance": 3.0,
    "lightAmbientCoeff": 0.45,
    "lightDiffuseCoeff": 0.5,
    "lightSpecularCoeff": 0.1,
}
_TILT = (0.3, 0.7)
"""Between the lamp's direction and the vertical [rad]."""


class Lens:
    """Light, blur and noise of all cameras of a plant; seed: of the plant."""

    def __init__(self, errors: CameraErrors, seed: int) -> None:
        self._errors, self._seed = errors, seed
        self.light: Mapping[str, Any] = _EVEN if errors.light == "even" else self._lamp()
        reach = math.ceil(3 * errors.blur)
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (errors.blur or 1.0)) ** 2)
        self._weights = (weights / weights.sum()).astype(np.float32)

    def _lamp(self) -> Mapping[str, Any]:
        tilt, turn = Noise(self._seed, "lamp").at(0).random(2).tolist()
        tilt, turn = _TILT[0] + tilt * (_TILT[1] - _TILT[0]), 2 * math.pi * turn
        sideways = math.tan(tilt)
        direction = (sideways * math.cos(turn), sideways * math.sin(turn), 1.0)
        return {**_LAMP, "lightDirection": direction}

    def colors(self, pixels: NDArray[np.uint8], camera: str, t_ns: int) -> NDArray[np.uint8]:
        """Return what a camera makes of colours, shape (h, w, 3), at a time [ns]."""
        errors = self._errors
        if not errors.blur and not errors.color:
            return pixels
        seen = pixels.astype(np.float32)
        seen = self._blurred(seen) if errors.blur else seen
        if errors.color:
            draws = Noise(self._seed, "color", camera).at(t_ns)
            noise = draws.standard_normal(pixels.shape, dtype=np.float32)
            seen += np.float32(errors.color) * noise
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)

    def depth(self, metres: NDArray[np.float32], camera: str, t_ns: int) -> NDArray[np.float32]:
        """Return what a camera makes of depth, shape (h, w) [m]; of nothing it makes nothing."""
        errors = self._errors
        if not (errors.depth or errors.depth_floor or errors.depth_bias):
            return metres
        draws = Noise(self._seed, "depth", camera).at(t_ns)
        noise = draws.standard_normal(metres.shape, dtype=np.float32)
        offset = errors.depth_bias * Noise(self._seed, "depth bias", camera).at(0).normal()
        known = np.isfinite(metres)
        near = np.where(known, metres, 0.0)
        spread = np.float32(errors.depth_floor) + np.float32(errors.depth) * near**2
        noisy = near + spread * noise + np.float32(offset)
        return np.where(known, noisy, np.inf).astype("<f4")

    def _blurred(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        height, width, channels = pixels.shape
        down = self._weighted(pixels.reshape(height, width * channels))
        # Neighbours in a row are as many values apart as a pixel has.
        across = self._weighted(down.reshape(height, width, channels).swapaxes(0, 1))
        return across.swapaxes(0, 1)

    def _weighted(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return weighted sums of neighbours along the first axis; beyond the rim it goes on."""
        reach, count = len(self._weights) // 2, len(pixels)
        rows = np.clip(np.arange(-reach, count + reach), 0, count - 1)
        padded = pixels[rows]
        part: NDArray[np.float32] = self._weights[0] * padded[:count]
        total = part.copy()
        for n, weight in enumerate(self._weights[1:], 1):
            np.multiply(weight, padded[n : n + count], out=part)
            total += part
        return total
