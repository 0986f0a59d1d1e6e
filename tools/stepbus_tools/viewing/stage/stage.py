"""A scene on a page: its nodes, what moves them, its light, and the floor below.

viser draws with three.js's filmic tone mapping, and has no option for it: what is fully lit comes
out darker and greyer. So meshes get the colour that it turns into theirs.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.theme import LINES
from stepbus_tools.viewing.rasteriser import rgb
from stepbus_tools.viewing.scene.meshes import Color, Visual
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene
from stepbus_tools.viewing.viewpoint import FLOOR_M, Box, Part, apart, framed, size_of
from stepbus_tools.viewing.viewpoint import MARGIN as _MARGIN

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
    values = np.array(color) / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    wanted = np.clip(_OUT @ linear, 0.0, _BRIGHTEST)
    # The fit is a quotient of two parabolas.
    a = 1.0 - wanted * 0.983729
    b = 0.0245786 - wanted * 0.4329510
    c = -0.000090537 - wanted * 0.238081
    before = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    shown = np.clip(_IN @ before / _EXPOSURE / _LIT, 0.0, 1.0)
    encoded = np.where(shown <= 0.0031308, shown * 12.92, 1.055 * shown ** (1 / 2.4) - 0.055)
    red, green, blue = np.rint(255 * encoded)
    return int(red), int(green), int(blue)


OTHER_COLOR: Color = rgb(LINES[3])
"""front.css has it too, in the legend of two recordings."""
_GHOST_COLOR: Color = (40, 140, 255)
_GHOST_OPACITY = 0.35
_CELL: Color = (128, 133, 140)
_SECTION: Color = (105, 110, 117)
_NEAR = 1e-9
_APART_M = 0.01
_APART_RAD = math.radians(1.0)
_STICKS = 0.5
"""A ghost that is shown stays until it is so much nearer."""


class Stage:
    """Draws a scene on a server of viser, and moves its frames.

    root: of its nodes. tint: colour of a scene that is only shown beside another one. shade: gives
    the colour to draw with in its light. paths: frame → its node.
    """

    def __init__(
        self,
        server: Any,
        scene: Scene,
        root: str = "/run",
        tint: Color | None = None,
        shade: Callable[[Color], Color] = drawn,
    ) -> None:
        self.scene = scene
        self._shade = shade
        self.paths: dict[str, str] = {"": root}
        self._server = server
        self._tint = tint
        self._nodes: dict[str, Any] = {}
        self._bodies: dict[str, list[Any]] = {}
        self._poses: dict[str, Pose] = {}
        ghost_meshes: dict[str, list[Any]] = {}
        with server.atomic():
            server.scene.add_frame(root, show_axes=False)
            for frame in scene.frames:
                # A slash would begin a node below it.
                name = frame.name.replace("/", "|") or "root"
                self.paths[frame.name] = f"{self.paths[frame.parent]}/{name}"
                if tint is None or not frame.is_ghost:
                    meshes = self._add(frame, self.paths[frame.name])
                    if frame.is_ghost and meshes:
                        ghost_meshes[frame.name] = meshes
                    elif frame.body:
                        self._bodies.setdefault(frame.body, []).extend(meshes)
        real = {frame.name: frame.ghost_of for frame in scene.frames if frame.is_ghost}
        self.ghosts = Ghosts(ghost_meshes, real)
        self.ghosts.compare(scene.placed({}) if self.ghosts else {})

    def _add(self, frame: Frame, path: str) -> list[Any]:
        """Add the node of a frame; returns what it looks like."""
        node = self._server.scene.add_frame(
            path, show_axes=False, position=frame.pose.position, wxyz=frame.pose.wxyz
        )
        self._nodes[frame.name], self._poses[frame.name] = node, frame.pose
        tint = _GHOST_COLOR if frame.is_ghost else self._tint
        return [
            self._add_visual(f"{path}/{number}", visual, tint)
            for number, visual in enumerate(frame.visuals)
        ]

    def _add_visual(self, path: str, visual: Visual, tint: Color | None) -> Any:
        is_floor = float(np.ptp(visual.mesh.vertices, axis=0).max()) >= FLOOR_M
        return self._server.scene.add_mesh_simple(
            path,
            vertices=visual.mesh.vertices,
            faces=visual.mesh.faces,
            color=self._shade(visual.shown_color if tint is None else tint),
            opacity=None if tint is None else _GHOST_OPACITY,
            flat_shading=True,
            side="double",
            cast_shadow=tint is None and not is_floor,
            # Drawn from both sides, since files turn some faces around, a body would shade itself.
            receive_shadow=is_floor,
            position=visual.pose.position,
            wxyz=visual.pose.wxyz,
        )

    def on_click(self, take: Callable[[str], None]) -> None:
        """Call `take` with the name of a body that is clicked at."""
        for body, meshes in self._bodies.items():
            for mesh in meshes:
                mesh.on_click(lambda _, name=body: take(name))

    def move(self, poses: Mapping[str, Pose]) -> None:
        """Move frames; nothing is sent of those that stay where they are."""
        has_moved = False
        for name in [name for name in poses if name in self._nodes]:
            node, pose, before = self._nodes[name], poses[name], self._poses[name]
            shifts = math.dist(pose.position, before.position) > _NEAR
            turns = math.dist(pose.wxyz, before.wxyz) > _NEAR
            if shifts:
                node.position = pose.position
            if turns:
                node.wxyz = pose.wxyz
            if shifts or turns:
                self._poses[name], has_moved = pose, True
        if has_moved and self.ghosts:
            self.ghosts.compare(self.scene.placed(self._poses))


class Ghosts:
    """Shows targets only where they differ from what is measured: the same place twice flickers.

    meshes: frame of a ghost → what it is drawn with. real: the same → the frame that it is of.
    """

    def __init__(self, meshes: Mapping[str, Sequence[Any]], real: Mapping[str, str]) -> None:
        self._meshes = meshes
        self._real = real
        self._apart: set[str] = set(meshes)
        self._visible = True

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._meshes)

    def show(self, *, visible: bool) -> None:
        """Show or hide the ghost meshes (reference poses)."""
        self._visible = visible
        for name in self._meshes:
            self._apply(name)

    def compare(self, poses: Mapping[str, Pose]) -> None:
        """Show ghosts that have gone, hide those that have arrived. poses: in the world."""
        for name in self._meshes:
            actual = poses.get(self._real[name])
            is_apart = actual is None or _apart(poses[name], actual) > (
                _STICKS if name in self._apart else 1.0
            )
            if is_apart != (name in self._apart):
                self._apart ^= {name}
                self._apply(name)

    def _apply(self, name: str) -> None:
        for mesh in self._meshes[name]:
            mesh.visible = self._visible and name in self._apart


def _apart(a: Pose, b: Pose) -> float:
    """Return how far two poses are apart; 1 is where an eye sees it."""
    cosine = min(1.0, abs(sum(x * y for x, y in zip(a.wxyz, b.wxyz, strict=True))))
    return max(math.dist(a.position, b.position) / _APART_M, 2 * math.acos(cosine) / _APART_RAD)


def add_floor(scene: Any, low: Any, high: Any) -> None:
    """Draw a grid of 0.5 m below a box. scene: of a server of viser."""
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    side = max(3.0, np.ceil(3.0 * size))
    scene.add_grid(
        "/floor",
        width=side,
        height=side,
        position=(float(middle[0]), float(middle[1]), min(0.0, float(low[2]))),
        cell_size=0.5,
        section_size=1.0,
        cell_color=_CELL,
        section_color=_SECTION,
        cell_thickness=0.5,
        fade_distance=2.0 * side,
        shadow_opacity=0.35,
    )


_PANEL_PX = 420
"""Of the controls, at the right of a page, with their margin."""
_COVERED = 0.5
"""Of a page that is higher than wide: the controls cover as much, from below (front.css)."""
_GREW = 0.05
_SAME = 1e-3


class Framing:
    """Keeps a box in the pictures of all visitors who have not moved their camera.

    server: of viser.
    """

    def __init__(self, server: Any) -> None:
        self._server = server
        self._floor: Box | None = None
        self._views: dict[int, _Camera] = {}

    def turn(self, box: Box, fixed: NDArray[np.float64]) -> None:
        """Place the cameras of those who have come, whose page or whose box has grown.

        box, fixed: of `Swept`.
        """
        clients = self._server.get_clients()
        self._views = {key: self._views.get(key) or _Camera() for key in clients}
        for key, client in clients.items():
            self._views[key].turn(client, box, fixed)
        if self._floor is None or apart(box, self._floor) > size_of(self._floor):
            self._floor = box
            add_floor(self._server.scene, *box)


class _Camera:
    """The camera of one visitor."""

    def __init__(self) -> None:
        self._ours: list[NDArray[np.float64]] = []
        self._box: Box | None = None
        self._size = (0, 0)

    def turn(self, client: Any, box: Box, fixed: NDArray[np.float64]) -> None:
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        has_grown = self._box is None or apart(box, self._box) > _GREW * size_of(box)
        apart_m = [float(np.linalg.norm(camera.position - ours)) for ours in self._ours]
        is_moved = min(apart_m, default=0.0) > _SAME * max(1.0, size_of(box))
        if (size == self._size and not has_grown) or is_moved:
            return
        self._box, self._size = box, size
        aspect = size[0] / max(1, size[1])
        view = framed(box, fixed=fixed, aspect=aspect, fov=camera.fov, free=free_part(*size))
        # It may still report where it was before.
        self._ours += [np.array(camera.position), view.eye] if not self._ours else [view.eye]
        with client.atomic():
            camera.position = tuple(view.eye.tolist())
            camera.look_at = tuple(view.target.tolist())


def free_part(width: int, height: int) -> Part:
    """Return the part of a page beside the controls."""
    if width < height:
        return (-_MARGIN, _MARGIN), (2 * _COVERED - 1 + (1 - _MARGIN), _MARGIN)
    right = max(0.0, 1 - 2 * _PANEL_PX / max(1, width))
    return (-_MARGIN, right - (1 - _MARGIN) / 2), (-_MARGIN, _MARGIN)
