#!/usr/bin/env bash
# Pinocchio: with mimic=True, a joint that follows another one must come after it in the tree, where
# branches stand by the alphabet: fingers named `a` (leads) and `b` (follows) load, `b` leads and `a`
# follows is "not in the kinematic tree". The order in the file does not matter; without mimic both load.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import sys

import pinocchio as pin

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="9"/>'


def hand(leader, follower):
    """Return a URDF of a palm with two fingers beside each other, of which one follows."""
    links = "".join(
        f'<link name="{name}">{INERTIAL}</link>' for name in ("palm", f"of_{leader}", f"of_{follower}")
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="palm"/><child link="of_{name}"/>{LIMIT}'
        f"{mimic}</joint>"
        for name, mimic in ((leader, ""), (follower, f'<mimic joint="{leader}"/>'))
    )
    return f'<robot name="hand">{links}{joints}</robot>'


def degrees_of_freedom(urdf, mimic):
    try:
        return pin.buildModelFromXML(urdf, mimic).nq
    except ValueError as exc:
        return str(exc)


seen = {
    (leader, follower, mimic): degrees_of_freedom(hand(leader, follower), mimic)
    for leader, follower in (("a", "b"), ("b", "a"))
    for mimic in (True, False)
}
print(f"pin {pin.__version__}")
print("guess: names do not matter: one degree of freedom with mimic=True, two without")
for (leader, follower, mimic), value in seen.items():
    print(f"seen: {follower} follows {leader}, mimic={mimic}: {value}")
first, second = seen["a", "b", True], seen["b", "a", True]
as_seen = first == 1 and "not in the kinematic tree" in str(second)
sys.exit(not (as_seen and seen["a", "b", False] == seen["b", "a", False] == 2))
PYTHON
