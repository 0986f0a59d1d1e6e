"""Worlds with devices: a base on two wheels, a gripper on a slide, boxes and cans."""

from pathlib import Path

from support.services.control import Stand, make_config

from stepbus_plant import Plant
from stepbus_schemas import Description


def link(name: str, mass: float, shape: str, at: str = "0 0 0", more: str = "") -> str:
    """Return a link of one shape, with inertias of a small solid."""
    inertia = 0.001 * mass
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>'
        f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>'
        f'</inertial><collision><origin xyz="{at}"/><geometry>{shape}</geometry></collision>'
        f"{more}</link>"
    )


def joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, limit: str) -> str:
    """Return a joint; limit: effort, velocity and, unless it turns without end, lower, upper."""
    names = ("effort", "velocity", "lower", "upper")
    bounds = " ".join(f'{n}="{v}"' for n, v in zip(names, limit.split(), strict=False))
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/><limit {bounds}/></joint>'
    )


def box(size: str) -> str:
    """Return the geometry of a box; size: x y z [m]."""
    return f'<box size="{size}"/>'


def ball(radius: float) -> str:
    """Return the geometry of a sphere; radius in [m]."""
    return f'<sphere radius="{radius}"/>'


def friction(lateral: float) -> str:
    """Return PyBullet's addition to a link that sets its friction [-]."""
    return f'<contact><lateral_friction value="{lateral}"/></contact>'


def write_urdf(folder: Path, name: str, *parts: str) -> None:
    """Write <name>.urdf from its links and joints."""
    (folder / f"{name}.urdf").write_text(f'<robot name="{name}">{"".join(parts)}</robot>')


def write_base(folder: Path) -> None:
    """Write base.urdf, 80 kg on spherical wheels of 0.1 m, 0.5 m apart, and ground.urdf."""
    wheels = [
        part
        for side, y in (("left", 0.25), ("right", -0.25))
        for part in (
            link(f"{side}_wheel", 1.0, ball(0.1), more=friction(1.5)),
            joint(side, "continuous", "chassis", f"{side}_wheel", f"0 {y} 0", "0 1 0", "50 50"),
        )
    ]
    casters = [
        part
        for end, x in (("front", 0.3), ("back", -0.3))
        for part in (
            link(end, 0.1, ball(0.05), more=friction(0.0)),
            joint(end, "fixed", "chassis", end, f"{x} 0 -0.05", "0 0 1", "0 0"),
        )
    ]
    chassis = link("chassis", 80.0, box("0.5 0.3 0.1"), "0 0 0.1")
    write_urdf(folder, "base", chassis, *wheels, *casters)
    write_ground(folder)


def write_ground(folder: Path) -> None:
    """Write ground.urdf, whose top is at z = 0."""
    write_urdf(folder, "ground", link("floor", 1.0, box("20 20 1"), "0 0 -0.5", friction(1.0)))


def write_gripper(folder: Path, *, boom: float = 0.0) -> None:
    """Write gripper.urdf, on a vertical slide, with ground.urdf and can.urdf.

    boom: distance of the gripper from the axis about which the joint `swing` turns it [m]; 0: there
    is no such joint.
    """
    write_ground(folder)
    write_can(folder)
    fingers = [
        part
        for side, sign in (("left", 1), ("right", -1))
        for part in (
            link(f"{side}_pad", 0.1, box("0.09 0.012 0.03"), f"0 {0.006 * sign} 0"),
            joint(
                side, "prismatic", "palm", f"{side}_pad", "0 0 -0.1", f"0 {sign} 0", "30 0 0 0.05"
            ),
        )
    ]
    write_urdf(
        folder,
        "gripper",
        link("rail", 1.0, box("0.02 0.02 0.02"), "0 0 1"),
        *(_boom(boom) if boom else ()),
        link("palm", 1.0, box("0.02 0.02 0.02")),
        joint(
            "lift",
            "prismatic",
            "boom" if boom else "rail",
            "palm",
            f"{boom} 0 0",
            "0 0 1",
            "100 1 0 0.3",
        ),
        *fingers,
    )


def _boom(length: float) -> tuple[str, ...]:
    turning = joint("swing", "revolute", "rail", "boom", f"{-length} 0 0", "0 0 1", "100 9 -3 3")
    return link("boom", 1.0, box("0.02 0.02 0.02"), "0 0 1"), turning


def write_can(folder: Path) -> None:
    """Write can.urdf: 0.35 kg, 66 mm wide, 115 mm high."""
    shape = '<cylinder radius="0.033" length="0.115"/>'
    write_urdf(folder, "can", link("can", 0.35, shape))


def make_stand(
    folder: Path,
    world: str,
    outputs: dict[str, str],
    inputs: dict[str, str],
    dynamics: str = "on",
    proximity: dict[str, float] | None = None,
    odometry: dict[str, float] | None = None,
    watchdog: str | None = None,
    **names: list[str],
) -> Stand:
    """Return a started plant; inputs, outputs: port → type; names: of an input's joints."""
    (folder / "world.yaml").write_text(world)
    params = {
        "world": "world.yaml",
        "dynamics": dynamics,
        "proximity": proximity or {},
        "odometry": odometry or {},
        "watchdog": watchdog,
    }
    config = make_config("plant", inputs, outputs, folder, params=params, publishes="first")
    participant = Plant(config)
    participant.start({port: Description(names=names.get(port, [])) for port in inputs})
    return Stand(participant)
