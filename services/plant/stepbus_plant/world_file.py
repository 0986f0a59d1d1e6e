"""Reads a world file: resolves its models, and draws its stock."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_participant import Problems, format_duration
from stepbus_participant.parameters import YamlFile
from stepbus_plant.stock import Item, draw_items
from stepbus_plant.world import Body, Friction, WorldFile, read_world


class World(WorldFile):
    """Everything that is simulated; `urdf` and `srdf` of each body are absolute paths.

    source: the file, which knows the line of each key. items: by the name of their body.
    """

    source: YamlFile
    items: dict[str, Item] = {}  # noqa: RUF012  Settings copy their defaults

    def physics_ns(self, period_ns: int) -> int:
        """Return the length of a physics substep [ns].

        period_ns: length of a communication step [ns]. Raises SettingsError unless the substep
        divides the step exactly.
        """
        step = f"the plant's step of {format_duration(period_ns)}"
        if self.physics_step_ns is None:
            step_ns, rest = divmod(period_ns, self.substeps or 1)
            if rest or not step_ns:
                text = f"{self.substeps} substeps do not divide {step} into whole nanoseconds"
                self.source.refuse([(("substeps",), text)])
            return step_ns
        if period_ns % self.physics_step_ns:
            text = f"{format_duration(self.physics_step_ns)} does not divide {step}"
            self.source.refuse([(("physics_step",), text)])
        return self.physics_step_ns


def load_world(
    path: Path,
    stock: Mapping[str, Any] | None = None,
    problems: Problems | None = None,
    *,
    seed: int = 0,
) -> World:
    """Read a world file.

    stock: `params.stock` of the plant; problems: of it. seed: of the run. Raises SettingsError that
    lists all mistakes, each with file and line. Loading the world reports those that only the URDFs
    reveal.
    """
    source, content, mistakes = read_world(path)
    mistakes.refuse()
    problems = Problems(above=("params", "stock")) if problems is None else problems
    items = draw_items(source, content, stock, seed=seed, problems=problems)
    fields = {key: getattr(content, key) for key in content.__struct_fields__}
    fields["bodies"] = {**content.bodies, **{item.name: _body_of(item) for item in items}}
    return World(**fields, source=source, items={item.name: item for item in items})


def _body_of(item: Item) -> Body:
    return Body(
        urdf=item.urdf,
        position=item.position,
        orientation_rpy=(0.0, 0.0, item.yaw),
        friction=Friction(lateral=item.friction, spinning=item.spinning_friction),
    )
