"""Light, shadows and true colours of a page.

viser draws with three.js's filmic tone mapping, and has no option for it: what is fully lit comes
out darker and greyer. So meshes get the colour that it turns into theirs.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from stepbus_tools.viewing.scene.meshes import Color

# three.js r180, ACESFilmicToneMapping: a fit of ACES by Stephen Hill.
_IN = np.linalg.inv(
    [(0.59719, 0.35458, 0.04823), (0.076, 0.90834, 0.01566), (0.0284, 0.13383, 0.83777)]
)
_OUT = np.linalg.inv(
    [(1.60475, -0.53108, -0.07367), (-0.10208, 1.10813, -0.00605), (-0.00327, -0.07276, 1.07602)]
)
_EXPOSURE = 1 / 0.6
_LIT = 1.15
"""How bright a white surface is that most of the light falls on."""
_BRIGHTEST = 0.98
_SUN, _SKY = 2.3, 2.1
_FROM = (1.2, -2.0, 3.2)


def add_light(scene: Any) -> None:
    """Light a scene from above and the front, with shadows, and evenly from all around.

    scene: of a server of viser.
    """
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_directional("/sun", intensity=_SUN, cast_shadow=True, position=_FROM)
    scene.add_light_hemisphere(
        "/sky", ground_color=(170, 170, 175), intensity=_SKY, position=(0.0, 0.0, 1.0)
    )


@lru_cache(maxsize=1024)
def drawn(color: Color) -> Color:
    """Return the colour that a surface needs to look as `color` where light falls on it."""
    wanted = np.clip(_OUT @ _linear(np.array(color) / 255), 0.0, _BRIGHTEST)
    # The fit is a quotient of two parabolas.
    a = 1.0 - wanted * 0.983729
    b = 0.0245786 - wanted * 0.4329510
    c = -0.000090537 - wanted * 0.238081
    before = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    red, green, blue = np.rint(255 * _encoded(np.clip(_IN @ before / _EXPOSURE / _LIT, 0.0, 1.0)))
    return int(red), int(green), int(blue)


def _linear(values: Any) -> Any:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _encoded(values: Any) -> Any:
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)
