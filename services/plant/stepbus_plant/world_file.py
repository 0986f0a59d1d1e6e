"""Reads a world file: resolves its models, and draws its stock."""

from pathlib import Path

from stepbus_participant import format_duration
from stepbus_participant.parameters import YamlFile
from stepbus_plant.stock import Item, draw_items, params_problems, stock_problems
from stepbus_plant.world import Body, Friction, StockParams, WorldFile, read_world
from stepbus_schemas import WiringError


class World(WorldFile):
    """Everything that is simulated; `urdf` and `srdf` of each body are absolute paths.

    source: the file, which knows the line of each key. items: by the name of their body.
    """

    source: YamlFile
    items: dict[str, Item] = {}  # noqa: RUF012  Settings copy their defaults

    def physics_ns(self, period_ns: int, instead_ns: int | None = None) -> int:
        """Return the length of a physics substep [ns].

        period_ns: length of a communication step [ns]. instead_ns: the params' `physics_step`,
        which overrides that of the file. Raises WiringError unless the substep divides the step
        exactly.
        """
        step = f"the plant's step of {format_duration(period_ns)}"
        if instead_ns is not None:
            if period_ns % instead_ns:
                text = f"{format_duration(instead_ns)} does not divide {step}"
                raise WiringError(f"params.physics_step: {text}")
            return instead_ns
        if self.physics_step_ns is not None:
            step_ns = self.physics_step_ns
            key, rest = "physics_step", period_ns % step_ns
            text = f"{format_duration(step_ns)} does not divide {step}"
        else:
            step_ns, rest = divmod(period_ns, self.substeps or 1)
            key = "substeps"
            text = f"{self.substeps} substeps do not divide {step} into whole nanoseconds"
        if rest or not step_ns:
            self.source.refuse([((key,), text)])
        return step_ns


def load_world(path: Path, stock: StockParams | None = None) -> World:
    """Read a world file.

    stock: `params.stock` of the plant.
    Raises WiringError that lists all mistakes, each with file and line. Loading the world reports
    those that only the URDFs reveal.
    """
    source, content, problems = read_world(path)
    problems.refuse()
    items = _items(content, source, stock)
    fields = {key: getattr(content, key) for key in content.__struct_fields__}
    fields["bodies"] = {**content.bodies, **{item.name: _body_of(item) for item in items}}
    return World(**fields, source=source, items={item.name: item for item in items})


def _items(content: WorldFile, source: YamlFile, params: StockParams | None) -> list[Item]:
    """Return the items on the shelves.

    Raises WiringError for mistakes in the stock and in `params.stock`.
    """
    stock, given = content.stock, params or StockParams()
    if stock is not None:
        source.refuse(stock_problems(stock, given, list(content.bodies)))
    if params is not None and (problems := params_problems(stock, params)):
        raise WiringError("\n".join(problems))
    return [] if stock is None else draw_items(stock, given)


def _body_of(item: Item) -> Body:
    return Body(
        urdf=item.urdf,
        position=item.position,
        orientation_rpy=(0.0, 0.0, item.yaw),
        friction=Friction(lateral=item.friction, spinning=item.spinning_friction),
    )
