"""What cameras see, drawn without a display."""

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_participant import installed_version
from stepbus_plant.engine import Light, PhysicsError
from stepbus_plant.engines.mujoco.model import BOTH, SEEN
from stepbus_plant.geometry import Array
from stepbus_schemas import WiringError

_MOST_GEOMS = 10_000
_WHITE = np.ones(3)
_DEFAULT = "egl" if sys.platform == "linux" else "glfw"
"""What MUJOCO_GL names, where it does not."""


class Painter:
    """Draws a model by OpenGL, in images of at most `width` × `height` [pixel].

    renderer: the name and version of the renderer. Raises WiringError where nothing can draw.
    """

    def __init__(self, model: Any, data: Any, width: int = 640, height: int = 480) -> None:
        self._model, self._data = model, data
        self.width, self.height = width, height
        self._closing = ExitStack()
        kind = (os.environ.get("MUJOCO_GL") or _DEFAULT).lower()
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        model.vis.quality.offsamples = 0
        try:
            # Not mujoco.gl_context, which has chosen when somebody first imported MuJoCo.
            self._gl = import_module(f"mujoco.{kind}").GLContext(width, height)
            self._closing.callback(self._gl.free)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            self._closing.callback(self._context.free)
            # What is freed are numbers of the current context: it may be another painter's.
            self._closing.callback(self._gl.make_current)
        except (AttributeError, ImportError, OSError, RuntimeError, mujoco.FatalError) as exc:
            raise WiringError(
                f"engine mujoco cannot render images with MUJOCO_GL={kind}: {exc}; on Debian and "
                "Ubuntu install libegl1 and libgl1-mesa-dri for egl, or libosmesa6 for osmesa, or "
                "set `cameras: false`"
            ) from exc
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZERONEAR
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 0
        self._option.geomgroup[[BOTH, SEEN]] = 1
        from OpenGL import GL  # noqa: PLC0415  it chooses its platform when it is loaded

        drawn = GL.glGetString(GL.GL_RENDERER).decode(errors="replace")
        self.renderer = f"mujoco {installed_version('mujoco')}, {drawn}"

    def close(self) -> None:
        """Let go of the display."""
        self._closing.close()

    def __del__(self, is_finalizing: Callable[[], bool] = sys.is_finalizing) -> None:
        """Let go of the display, before MuJoCo does so in whichever context is current."""
        if not is_finalizing():
            self.close()

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """See `Engine`; raises PhysicsError for an error of OpenGL."""
        width, height = size
        self._gl.make_current()
        scene = self._scene
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            self._option,
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_STATIC | mujoco.mjtCatBit.mjCAT_DYNAMIC,
            scene,
        )
        self._aim(view, projection)
        self._shine(light)
        colours = np.empty((height, width, 3), dtype=np.uint8)
        depth = np.empty((height, width), dtype=np.float32)
        place = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(place, scene, self._context)
        mujoco.mjr_readPixels(colours, depth, place, self._context)
        if error := mujoco.mjr_getError():
            raise PhysicsError(
                f"OpenGL reports error {error:#x} for an image of {width} x {height}"
            )
        colours[depth >= 1.0] = 255
        # OpenGL counts rows from below.
        return colours[::-1].copy(), depth[::-1].astype(np.float64)

    def _aim(self, view: Array, projection: Array) -> None:
        """Look as the matrices of OpenGL say."""
        turn = view[:3, :3].T
        position = -turn @ view[:3, 3]
        near = projection[2, 3] / (projection[2, 2] - 1.0)
        far = projection[2, 3] / (projection[2, 2] + 1.0)
        half_width, half_height = near / projection[0, 0], near / projection[1, 1]
        across, up = projection[0, 2] * half_width, projection[1, 2] * half_height
        for camera in self._scene.camera:
            camera.pos, camera.forward, camera.up = position, -turn[:, 2], turn[:, 1]
            camera.frustum_near, camera.frustum_far = near, far
            camera.frustum_center, camera.frustum_width = across, half_width
            camera.frustum_bottom, camera.frustum_top = up - half_height, up + half_height
            camera.orthographic = 0

    def _shine(self, light: Light) -> None:
        scene = self._scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(light.has_shadow)
        scene.nlight = 2
        towards = np.array(light.direction) / np.linalg.norm(light.direction)
        # What is in a shadow has no light of the lamp, not even the ambient one.
        for lamp, is_ambient in zip(scene.lights, (False, True), strict=False):
            lamp.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
            lamp.pos, lamp.dir = light.distance * towards, -towards
            lamp.attenuation = (1.0, 0.0, 0.0)
            lamp.headlight, lamp.castshadow = 0, int(light.has_shadow and not is_ambient)
            lamp.ambient = is_ambient * light.ambient * _WHITE
            lamp.diffuse = (not is_ambient) * light.diffuse * _WHITE
            lamp.specular = (not is_ambient) * light.specular * _WHITE
