"""What each engine does otherwise, or cannot do: the table of docs/guide/running/engines.md."""

from typing import NamedTuple


class Difference(NamedTuple):
    """What the engines do not do alike, and what each one does."""

    what: str
    pybullet: str
    mujoco: str


STIFFNESS = "`<stiffness>` and `<damping>` of a link's `<contact>`"
PLANES = "a plane on a link that moves"

DIFFERENCES = (
    Difference("Python", "3.11", "3.11 and later"),
    Difference(
        "checkpoints",
        "bodies with a fixed base, at steps without contact",
        "to the bit, with contacts; not while images with a latency are drawn, and not with "
        "cameras that wait for requests",
    ),
    Difference("joint damping", "explicit: too much of it diverges", "implicit: always stable"),
    Difference(
        "contacts",
        "impulses in sequence, shapes up to 1 mm apart where they rest",
        "one convex problem; what rests overlaps, by an amount that grows with the square of "
        "`physics_step`: a box of 1 kg by 0.4 µm at 1 ms, by 10 µm at 5 ms, by 156 µm at 20 ms",
    ),
    Difference(
        "friction of two links",
        "the product of their coefficients",
        "the same: the larger one, MuJoCo's own choice, is overridden",
    ),
    Difference("cylinders of a URDF", "32 faces and a margin", "exact"),
    Difference(
        "meshes",
        "convex hulls, one for each object of an OBJ",
        "convex hulls, one for each file; a flat one is seen and touches nothing",
    ),
    Difference(
        "what a lidar sees of a mesh, and of a shape that it begins in",
        "its convex hull; nothing",
        "its triangles; the inside",
    ),
    Difference("an inertia that no body can have", "taken", "the nearest one that a body can have"),
    Difference("`<mimic>` and the coupling of a gripper", "with a largest force", "without one"),
    Difference("`sleeping: true`", "skips bodies at rest", "computes all bodies"),
    Difference(STIFFNESS, "taken", "refused"),
    Difference(PLANES, "taken", "refused"),
    Difference("a box, ball, cylinder or capsule without extent", "taken", "refused"),
    Difference(
        "images",
        "TinyRenderer: the same bytes on every machine, drawn beside the steps",
        "OpenGL (EGL, OSMesa or GLFW): bytes depend on the driver, which the recording names; "
        "drawn within the step; textures are left out",
    ),
)


def table() -> str:
    """Return the table as Markdown."""
    rows = [("", "pybullet", "mujoco"), ("---", "---", "---"), *DIFFERENCES]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows).replace("|  |", "| |")


def refused(what: str) -> str:
    """Return the sentence that MuJoCo cannot do something."""
    return f"{what}: not with engine mujoco; use engine pybullet, or leave it out"
