"""What MJCF has and URDF has not, and what becomes of it: the table of docs/reference/world.md."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from stepbus_schemas import WiringError

from .mjcf_model import Mjcf

SHAPES = ("box", "sphere", "cylinder", "capsule", "mesh")
_MUSCLE = "muscle"
_SHOWN = 5


class Kind(NamedTuple):
    """Something of MJCF.

    fate: `refused`, `warning` (and left out), or `left out`. instead: why, or what to use. find:
    names of those that a model has; None: nothing looks for it.
    """

    what: str
    fate: str
    instead: str
    find: Callable[[Mjcf], Iterator[str]] | None = None


def take_stock(mjcf: Mjcf) -> str:
    """Return a sentence about what is left out of a model; empty: nothing that it would miss.

    Raises WiringError that lists what is refused, a line each.
    """
    matches = [(kind, list(kind.find(mjcf))) for kind in KINDS if kind.find is not None]
    rows = [(kind, names) for kind, names in matches if names]
    refused = [
        f"{mjcf.path}: {kind.what} ({_some(names)}): not supported; {kind.instead}"
        for kind, names in rows
        if kind.fate == "refused"
    ]
    if refused:
        raise WiringError("\n".join(refused))
    left = [f"{kind.what} ({_some(names)})" for kind, names in rows]
    return (
        f"URDF cannot express some of this MJCF, which is ignored: {'; '.join(left)}"
        if left
        else ""
    )


def table() -> str:
    """Return the table as Markdown."""
    rows = [("In MJCF", "Result", "Reason or alternative"), ("---", "---", "---")]
    rows += [(kind.what, kind.fate, kind.instead) for kind in KINDS]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


# --- what looks for each of them ----------------------------------------------------------


def _ball_joints(mjcf: Mjcf) -> Iterator[str]:
    for joint, name in enumerate(mjcf.joints):
        if mjcf.joint_kind(joint) == "ball":
            yield name


def _springs(mjcf: Mjcf) -> Iterator[str]:
    model = mjcf.model
    for joint, name in enumerate(mjcf.joints):
        if model.jnt_stiffness[joint] or model.jnt_stiffnesspoly[joint].any():
            yield name


_TENDON_FORCES = (
    *("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "armature"),
    *("limited",),
)


def _tendons(mjcf: Mjcf) -> Iterator[str]:
    for tendon, name in enumerate(mjcf.tendons):
        values = (getattr(mjcf.model, f"tendon_{key}")[tendon] for key in _TENDON_FORCES)
        if any(value.any() for value in values):
            yield name


def _active(mjcf: Mjcf) -> Iterator[tuple[int, str, str]]:
    """Yield number, name and kind of each active equality constraint."""
    for row, name in enumerate(mjcf.equalities):
        if mjcf.model.eq_active0[row]:
            yield row, name, mjcf.kind("mjtEq", mjcf.model.eq_type[row])


def _loops(mjcf: Mjcf) -> Iterator[str]:
    for _, name, kind in _active(mjcf):
        if kind != "joint":
            yield f"{kind} {name}"


def _curves(mjcf: Mjcf) -> Iterator[str]:
    for row, name, kind in _active(mjcf):
        follows = mjcf.model.eq_obj2id[row] >= 0
        if kind == "joint" and (not follows or mjcf.model.eq_data[row, 2:5].any()):
            yield name


def _twice_coupled(mjcf: Mjcf) -> Iterator[str]:
    rows = [row for row, _, kind in _active(mjcf) if kind == "joint"]
    followers = [int(mjcf.model.eq_obj1id[row]) for row in rows]
    for joint in dict.fromkeys(followers):
        if followers.count(joint) > 1:
            yield mjcf.joints[joint]


def _muscles(mjcf: Mjcf) -> Iterator[str]:
    for row, name in enumerate(mjcf.actuators):
        actuator = mjcf.model.actuator(row)
        kinds = {
            mjcf.kind(f"mjt{kind.capitalize()}", int(getattr(actuator, f"{kind}type")[0]))
            for kind in ("dyn", "gain", "bias")
        }
        if _MUSCLE in kinds:
            yield name


def _flexes(mjcf: Mjcf) -> Iterator[str]:
    yield from (f"flex{n}" for n in range(mjcf.model.nflex))


def _plugins(mjcf: Mjcf) -> Iterator[str]:
    yield from mjcf.plugins


def _in_bodies(mjcf: Mjcf) -> Iterator[tuple[int, str, str]]:
    """Yield number, name and kind of each geom of a body."""
    for geom, name in enumerate(mjcf.geoms):
        if mjcf.model.geom_bodyid[geom] > 0:
            yield geom, name, mjcf.geom_kind(geom)


def _solid_shapes(mjcf: Mjcf) -> Iterator[str]:
    for geom, name, kind in _in_bodies(mjcf):
        if kind not in SHAPES and mjcf.is_solid(geom):
            yield f"{kind} {name}"


def _seen_shapes(mjcf: Mjcf) -> Iterator[str]:
    for geom, name, kind in _in_bodies(mjcf):
        if kind not in SHAPES and not mjcf.is_solid(geom) and mjcf.is_seen(geom):
            yield f"{kind} {name}"


def _odd_meshes(mjcf: Mjcf) -> Iterator[str]:
    for geom, name, kind in _in_bodies(mjcf):
        if kind == "mesh" and (mjcf.is_solid(geom) or mjcf.is_seen(geom)):
            problem = mjcf.mesh_problem(geom)
            if problem:
                yield f"{name} of {mjcf.bodies[mjcf.model.geom_bodyid[geom]]} {problem}"


def _surfaces(mjcf: Mjcf) -> Iterator[str]:
    for geom, name, _ in _in_bodies(mjcf):
        if mjcf.model.geom_adhesion[geom].any() or mjcf.model.geom_surfacevel[geom].any():
            yield name


def _armatures(mjcf: Mjcf) -> Iterator[str]:
    joints = (int(joint) for joint in mjcf.model.dof_jntid[mjcf.model.dof_armature > 0])
    yield from dict.fromkeys(mjcf.joints[joint] for joint in joints)


def _weightless(mjcf: Mjcf) -> Iterator[str]:
    for body, name in enumerate(mjcf.bodies):
        if mjcf.model.body_gravcomp[body]:
            yield name


def _far_actuators(mjcf: Mjcf) -> Iterator[str]:
    for row, name in enumerate(mjcf.actuators):
        kind = mjcf.kind("mjtTrn", int(mjcf.model.actuator(row).trntype[0]))
        if not kind.startswith("joint"):
            yield f"{name} on a {kind}"


def _scenery(mjcf: Mjcf) -> Iterator[str]:
    yield from (mjcf.geoms[geom] for geom in mjcf.geoms_of(0))


def _frictions(mjcf: Mjcf) -> Iterator[str]:
    for body, name in enumerate(mjcf.bodies):
        solid = [geom for geom in mjcf.geoms_of(body) if mjcf.is_solid(geom)]
        if body and len({float(mjcf.model.geom_friction[geom, 0]) for geom in solid}) > 1:
            yield name


def _pairs(mjcf: Mjcf) -> Iterator[str]:
    for one, other in zip(mjcf.model.pair_geom1, mjcf.model.pair_geom2, strict=True):
        yield f"{mjcf.geoms[one]} and {mjcf.geoms[other]}"


def _fluid(mjcf: Mjcf) -> Iterator[str]:
    option: Any = mjcf.model.opt
    given = {"density": option.density, "viscosity": option.viscosity, "wind": option.wind.any()}
    yield from (key for key, value in given.items() if value)


KINDS = (
    Kind("ball joints", "refused", "use three hinges in one body", _ball_joints),
    Kind("joint springs (`stiffness`)", "refused", "remove them", _springs),
    Kind(
        "tendons with a spring, damping, friction, armature or limits",
        "refused",
        "remove these; tendons that only measure or transmit are left out",
        _tendons,
    ),
    Kind(
        "constraints `connect`, `weld`, … (active ones)",
        "refused",
        "a robot is a tree, closed chains are not supported",
        _loops,
    ),
    Kind(
        "joint couplings that are not linear, or without a second joint",
        "refused",
        "use `joint2` and a `polycoef` of two numbers",
        _curves,
    ),
    Kind("joints that follow two others", "refused", "keep one of the couplings", _twice_coupled),
    Kind("muscles", "refused", "use motors", _muscles),
    Kind("flexes", "refused", "only rigid bodies are supported", _flexes),
    Kind("plugins", "refused", "remove them", _plugins),
    Kind(
        "collision geoms that are ellipsoids, planes, height fields or SDFs",
        "refused",
        "use boxes, spheres, cylinders, capsules or meshes",
        _solid_shapes,
    ),
    Kind(
        "meshes not in an STL or OBJ file, or with `refquat` and a non-uniform `scale`",
        "refused",
        "export them to STL or OBJ with the transform applied",
        _odd_meshes,
    ),
    Kind(
        "visual-only geoms of these shapes",
        "warning",
        "use a supported shape",
        _seen_shapes,
    ),
    Kind("`armature` of joints", "warning", "URDF has no rotor inertia", _armatures),
    Kind("`gravcomp` of bodies", "warning", "compensate gravity in the controller", _weightless),
    Kind("actuators of anything but a joint", "warning", "commands go to joints", _far_actuators),
    Kind(
        "geoms of the `<worldbody>` itself, e.g. a floor",
        "warning",
        "the world has bodies of its own",
        _scenery,
    ),
    Kind(
        "different friction of geoms of one body",
        "warning",
        "the link gets the largest",
        _frictions,
    ),
    Kind("contact pairs (`<pair>`)", "warning", "friction belongs to links, not to pairs", _pairs),
    Kind(
        "adhesion and surface velocity of geoms",
        "warning",
        "contacts only have friction",
        _surfaces,
    ),
    Kind("density, viscosity and wind of `<option>`", "warning", "there is no fluid", _fluid),
    Kind(
        "other options, keyframes, `<size>`, `<custom>`",
        "left out",
        "the world file sets these",
    ),
    Kind("free joints, pose of the root, `mocap`", "left out", "the world file has these"),
    Kind("`<exclude>`", "left out", "links of a body collide only with an `srdf`"),
    Kind("contact masks other than 0", "left out", "a geom collides with all others or with none"),
    Kind("`solref`, `solimp`, `margin`, …", "left out", "contacts and joint stops are rigid"),
    Kind("actuator gains", "left out", "the `mode` of a joint sets how it is commanded"),
    Kind("tendons that only measure or transmit", "left out", "commands go to joints"),
    Kind("inactive constraints", "left out", "they cannot be activated"),
    Kind("sensors", "left out", "the world file has its own"),
    Kind("sites, cameras, lights, textures, skins", "left out", "they do not affect the motion"),
    Kind("geoms of groups 3 to 5", "left out", "visual geoms only; solid ones collide"),
)


def _some(names: list[str]) -> str:
    return ", ".join([*names[:_SHOWN], *([f"{len(names)} in all"] if len(names) > _SHOWN else [])])
