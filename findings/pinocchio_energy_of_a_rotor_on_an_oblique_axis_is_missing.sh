#!/usr/bin/env bash
# Pinocchio: `armature`, the inertia of the rotors, is in the mass matrix, and in the kinetic energy of
# every kind of joint but one: a revolute joint whose axis is not x, y or z. There, the energy is not
# v·M·v / 2, and an energy balance does not close.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import sys

import numpy as np
import pinocchio as pin

OBLIQUE = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
JOINTS = (
    pin.JointModelRX(),
    pin.JointModelRevoluteUnaligned(OBLIQUE),
    pin.JointModelPX(),
    pin.JointModelPrismaticUnaligned(OBLIQUE),
    pin.JointModelSpherical(),
    pin.JointModelFreeFlyer(),
)
ARMATURE = 0.7


def missing(joint):
    """Return v·M·v / 2 less the kinetic energy, and the energy of the rotors alone [J]."""
    model = pin.Model()
    number = model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(number, pin.Inertia.Identity(), pin.SE3.Identity())
    model.armature = np.full(model.nv, ARMATURE)
    data = model.createData()
    q, v = pin.neutral(model), np.linspace(0.5, 1.5, model.nv)
    upper = np.triu(pin.crba(model, data, q))
    mass = upper + np.triu(upper, 1).T
    energy = pin.computeKineticEnergy(model, data, q, v)
    return v @ mass @ v / 2 - energy, ARMATURE * v @ v / 2


print(f"pin {pin.__version__}")
print("guess: with armature, the kinetic energy is v·M·v / 2 for every joint")
as_seen = True
for joint in JOINTS:
    name = joint.shortname()
    lacking, rotors = missing(joint)
    print(f"seen: {name} lacks {lacking + 0.0:.4f} J; its rotors have {rotors:.4f} J")
    expected = rotors if name == "JointModelRevoluteUnaligned" else 0.0
    as_seen &= bool(np.isclose(lacking, expected, atol=1e-9))
sys.exit(not as_seen)
PYTHON
