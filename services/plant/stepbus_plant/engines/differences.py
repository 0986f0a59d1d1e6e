"""What each engine does otherwise, or cannot do: the table of docs/guide/running/engines.md."""

from typing import Any, NamedTuple


class Difference(NamedTuple):
    """What the engines do not do alike, and what each one does."""

    what: str
    pybullet: str
    mujoco: str


PYBULLET_CONTACT = (
    "restitution",
    "stiffness",
    "damping",
    "contact_cfm",
    "contact_erp",
    "friction_anchor",
    "inertia_scaling",
)
"""Elements of a link's `<contact>` that PyBullet alone reads."""
PLANES = "engine mujoco does not support a `<plane>` in a URDF; use engine pybullet, or remove it"

DIFFERENCES = (
    Difference("Python", "3.11", "3.11 and later"),
    Difference(
        "checkpoints",
        "fixed-base bodies, at steps without contact",
        "bit-exact, also with contacts; not while images with a latency are rendered, nor with "
        "triggered cameras",
    ),
    Difference("joint damping", "explicit: large values diverge", "implicit: always stable"),
    Difference(
        "contacts",
        "sequential impulses; boxes and balls touch; a mesh or URDF cylinder rests 1 mm above a "
        "box, and 2 mm above another",
        "springs of 10 ms, or of the `solref` of an MJCF: a box at rest sinks by "
        "27 µm, what falls at 2 m/s by 8 mm",
    ),
    Difference(
        "friction between two links",
        "the product of their coefficients",
        "the larger one; one that is given goes over MuJoCo's own, 1; of 0, such as a caster's: 0",
    ),
    Difference("URDF cylinders", "32 faces and a margin", "exact"),
    Difference(
        "meshes",
        "convex hulls, one per object in an OBJ",
        "convex hulls, one per file; a flat mesh has none, and is refused as a collision shape",
    ),
    Difference("lidar ray at a mesh", "hits its convex hull", "hits the mesh"),
    Difference(
        "a body that a script moves",
        "pushes at its velocity",
        "pushes as far as it enters the other; its surface carries what is on it",
    ),
    Difference(
        "free body whose frame is not at its centre of mass",
        "flies straight",
        "strays with `physics_step`, by 0.3 % at 3 rad/s and 1 ms",
    ),
    Difference("MJCF", "refused", "read as it is"),
    Difference("lidar ray that starts inside a shape", "no hit", "hits the inside"),
    Difference("`<mimic>` and gripper coupling", "limited force", "unlimited force"),
    Difference("`sleeping: true`", "skips bodies at rest", "computes all bodies"),
    Difference("a `<plane>` in a URDF", "accepted", "refused"),
    Difference("a box, ball, cylinder or capsule of size 0", "accepted", "refused"),
    Difference(
        "images",
        "TinyRenderer: the same bytes on every machine, rendered in parallel with the steps",
        "OpenGL (EGL, OSMesa or GLFW): bytes depend on the driver, which the recording names; "
        "rendered within the step",
    ),
)


_FRICTIONS = "`lateral_friction`, `rolling_friction`, `spinning_friction`"
ELEMENTS = (
    ("`<axis>`", "a direction, of any length"),
    ("`<limit>`: `lower`, `upper`", "stops; not of continuous joints"),
    ("`<limit>`: `effort`, `velocity`", "the limits of the motor; 0 `velocity`: none"),
    ("`<dynamics>`: `damping`, `friction`", "not used; give them in the world file"),
    ("`<mimic>`: `joint`, `multiplier`, `offset`", "the joint follows the other one"),
    (f"`<contact>`: {_FRICTIONS}", "coefficients of friction"),
    (
        f"`<contact>`: {', '.join(f'`{tag}`' for tag in PYBULLET_CONTACT)}",
        "used by pybullet; mujoco warns",
    ),
    (
        "`<inertia>` that no body can have",
        "replaced by a third of its trace about every axis, or by that of a plate; with a warning",
    ),
    ("`<safety_controller>`, `<calibration>`, `<transmission>`, `<gazebo>`", "not used"),
)
"""Element of a URDF → what both engines, and the model of a controller, do with it."""


def table(head: tuple[str, ...] = ("", "pybullet", "mujoco"), rows: Any = DIFFERENCES) -> str:
    """Return a table as Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines).replace("|  |", "| |")
