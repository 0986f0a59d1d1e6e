#!/usr/bin/env bash
# PyBullet: resetSimulation puts gravity and the solver iterations back, and keeps the time step and the substeps.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==1.26.4
cat > "$folder/try.py" <<'PYTHON'
import pybullet

pybullet.connect(pybullet.DIRECT)
default = pybullet.getPhysicsEngineParameters()
pybullet.setTimeStep(0.01)
pybullet.setGravity(0, 0, -5)
pybullet.setPhysicsEngineParameter(numSolverIterations=7, numSubSteps=3)
pybullet.resetSimulation()
after = pybullet.getPhysicsEngineParameters()
for name in ("fixedTimeStep", "numSubSteps", "gravityAccelerationZ", "numSolverIterations"):
    print(name, round(default[name], 6), round(after[name], 6))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "PyBullet 3.2.7: each parameter by default, and after a change and resetSimulation"
echo "guess: all four are the defaults again, or all four stay"
echo "seen:  the time step and the substeps stay, gravity and iterations are the defaults"
printf 'fixedTimeStep 0.004167 0.01\nnumSubSteps 0 3\ngravityAccelerationZ 0.0 0.0\nnumSolverIterations 50 50\n' | cmp - "$folder/seen"
