#!/usr/bin/env bash
# mujoco 4.0.0 (Python): freeing the rendering context of one window spoils the images of another.
#
# Two renderers in one process, each with an OpenGL context (EGL) and an MjrContext of its own. The
# first MjrContext is freed while the OpenGL context of the second is the current one.
#
# Guess:  each MjrContext frees its own buffers; the second renderer goes on.
# Seen:   the buffers that are freed are those of the same number in the current OpenGL context. From
#         then on the second renderer draws nothing: mjr_readPixels leaves the array as it was, no
#         exception is raised, and only mjr_getError tells (0x506, an incomplete framebuffer). The
#         same happens where the first one is merely dropped and collected as garbage.
# So:     make a context's own OpenGL context current before its MjrContext is freed, and ask
#         mjr_getError behind each mjr_readPixels.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
cat >"$folder/try.py" <<'PY'
import mujoco
import numpy as np
from mujoco.egl import GLContext

model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)


def renderer():
    gl = GLContext(64, 64)
    gl.make_current()
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    return gl, context


def draw(gl, context):
    gl.make_current()
    scene, camera = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    camera.distance = 5
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    rgb, place = np.full((64, 64, 3), 7, np.uint8), mujoco.MjrRect(0, 0, 64, 64)
    mujoco.mjr_render(place, scene, context)
    mujoco.mjr_readPixels(rgb, None, place, context)
    return rgb[32, 32].tolist(), hex(mujoco.mjr_getError())


first, second = renderer(), renderer()
draw(*first)
print("before", *draw(*second))
first[1].free()
print("after", *draw(*second))
PY
MUJOCO_GL=egl "$folder/venv/bin/python" "$folder/try.py" | tee "$folder/seen"
grep -qE '^before \[[0-9]{3}, [0-9]+, [0-9]+\] 0x0$' "$folder/seen"
grep -qFx 'after [7, 7, 7] 0x506' "$folder/seen"
