"""The world of a plant with what a script has added to it before the simulation."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

from msgspec import structs

from stepbus_coppelia.plant import Primitive, SceneParams
from stepbus_plant import World
from stepbus_plant.world import Body, Friction
from stepbus_schemas import Point


@dataclass
class Weighed:
    """A body of one link whose mass a script has set, as an item of the world; see `Item`."""

    name: str
    type: str
    urdf: Path
    position: Point
    yaw: float
    slot: Point
    slot_yaw: float
    mass: float
    friction: float
    spinning_friction: float


def scene_world(world: World, params: SceneParams) -> World:
    """Return a world with the primitives, models and masses of a script."""
    if not (params.primitives or params.models or params.masses):
        return world
    bodies, items = {**world.bodies, **params.models}, dict(world.items)
    folder = Path(mkdtemp(prefix="stepbus-shapes-")) if params.primitives else Path()
    for name, shape in params.primitives.items():
        urdf = folder / f"{name}.urdf"
        urdf.write_text("".join(_urdf(name, shape)), encoding="utf-8")
        bodies[name] = Body(urdf=urdf, position=shape.position, fixed_base=shape.static)
    for name, mass in params.masses.items():
        body, friction = bodies[name], bodies[name].friction or Friction()
        where = body.position, body.orientation_rpy[2]
        spinning = friction.spinning or 0.0
        lateral = 0.5 if friction.lateral is None else friction.lateral
        items[name] = Weighed(name, "", body.urdf, *where, *where, mass, lateral, spinning)
    return structs.replace(world, bodies=bodies, items=items)


def _urdf(name: str, shape: Primitive) -> Iterator[str]:
    """Yield the text of a model of one link."""
    x, y, z = shape.size
    form = {
        "box": f'<box size="{x} {y} {z}"/>',
        "sphere": f'<sphere radius="{x / 2}"/>',
        "cylinder": f'<cylinder radius="{x / 2}" length="{z}"/>',
    }[shape.kind]
    # Moments of a solid of even density, over its mass.
    moments = {
        "box": ((y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12),
        "sphere": (x * x / 10,) * 3,
        "cylinder": (x * x / 16 + z * z / 12, x * x / 16 + z * z / 12, x * x / 8),
    }[shape.kind]
    mass = shape.mass
    xx, yy, zz = (moment * mass for moment in moments)
    red, green, blue = shape.colour
    yield f'<robot name="{name}"><link name="{name}"><inertial><mass value="{mass}"/>'
    yield f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    yield f'<visual><geometry>{form}</geometry><material name="own"><color rgba="'
    yield f'{red} {green} {blue} 1"/></material></visual>'
    if shape.respondable:
        yield f"<collision><geometry>{form}</geometry></collision>"
    yield "</link></robot>\n"
