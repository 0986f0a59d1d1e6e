"""A scene on a page: its nodes, and what moves them."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from stepbus_tools.viewing.scene import Color, Frame, Pose, Scene, Visual

from .ghosts import Ghosts

GHOST_COLOR: Color = (40, 140, 255)
OTHER_COLOR: Color = (255, 120, 30)
_GHOST_OPACITY = 0.35
_NEAR = 1e-9


class Stage:
    """Draws a scene on a server of viser, and moves its frames.

    root: of its nodes. tint: colour of a scene that is only shown beside another one. paths: frame
    → its node.
    """

    def __init__(self, server: Any, scene: Scene, root: str = "/run", tint: Color | None = None):
        self.scene = scene
        self._server = server
        self._tint = tint
        self._nodes: dict[str, Any] = {}
        self._bodies: dict[str, list[Any]] = {}
        self._ghost_meshes: dict[str, list[Any]] = {}
        self._poses: dict[str, Pose] = {}
        paths: dict[str, str] = {"": root}
        self.paths = paths
        with server.atomic():
            self._root = server.scene.add_frame(root, show_axes=False)
            for frame in scene.frames:
                paths[frame.name] = f"{paths[frame.parent]}/{_node_name(frame.name)}"
                self._add(frame, paths[frame.name])
        self._ghosts = Ghosts(self._ghost_meshes)
        self._ghosts.compare(scene.placed({}) if self._ghosts else {})

    def _add(self, frame: Frame, path: str) -> None:
        if self._tint is not None and frame.is_ghost:
            return
        node = self._server.scene.add_frame(
            path, show_axes=False, position=frame.pose.position, wxyz=frame.pose.wxyz
        )
        self._nodes[frame.name], self._poses[frame.name] = node, frame.pose
        for number, visual in enumerate(frame.visuals):
            mesh = self._add_visual(f"{path}/{number}", frame, visual)
            if not frame.is_ghost and frame.body:
                self._bodies.setdefault(frame.body, []).append(mesh)
            if frame.is_ghost:
                self._ghost_meshes.setdefault(frame.name, []).append(mesh)

    def _add_visual(self, path: str, frame: Frame, visual: Visual) -> Any:
        ghost = GHOST_COLOR if frame.is_ghost else self._tint
        return self._server.scene.add_mesh_simple(
            path,
            vertices=visual.mesh.vertices,
            faces=visual.mesh.faces,
            color=visual.shown_color if ghost is None else ghost,
            opacity=None if ghost is None else _GHOST_OPACITY,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            position=visual.pose.position,
            wxyz=visual.pose.wxyz,
        )

    @property
    def has_ghosts(self) -> bool:
        """Return whether the scene shows targets."""
        return bool(self._ghosts)

    def show_ghosts(self, *, visible: bool) -> None:
        """Show or hide where joints should be."""
        self._ghosts.show(visible=visible)

    def on_click(self, take: Callable[[str], None]) -> None:
        """Call `take` with the name of a body that is clicked at."""
        for body, meshes in self._bodies.items():
            for mesh in meshes:
                mesh.on_click(lambda _, name=body: take(name))

    def show(self, *, visible: bool) -> None:
        """Show or hide all of it."""
        self._root.visible = visible

    def move(self, poses: Mapping[str, Pose]) -> int:
        """Move frames; returns how many have moved."""
        moved = [(name, pose) for name, pose in poses.items() if self._has_moved(name, pose)]
        for name, pose in moved:
            node, before = self._nodes[name], self._poses[name]
            if _differ(pose.position, before.position):
                node.position = pose.position
            if _differ(pose.wxyz, before.wxyz):
                node.wxyz = pose.wxyz
            self._poses[name] = pose
        if moved and self._ghosts:
            self._ghosts.compare(self.scene.placed(self._poses))
        return len(moved)

    def _has_moved(self, name: str, pose: Pose) -> bool:
        before = self._poses.get(name)
        return before is not None and (
            _differ(pose.position, before.position) or _differ(pose.wxyz, before.wxyz)
        )


def _differ(a: Iterable[float], b: Iterable[float]) -> bool:
    return any(abs(x - y) > _NEAR for x, y in zip(a, b, strict=True))


def _node_name(name: str) -> str:
    """Return a frame's name as part of a path in viser."""
    return name.replace("/", "|") or "root"
