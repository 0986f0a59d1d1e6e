#!/usr/bin/env bash
# Crocoddyl: limits of the control are part of the action model; the usual solvers leave them out.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet crocoddyl==3.2.1 pin==4.1.0
cat > "$folder/try.py" <<'PYTHON'
import crocoddyl
import numpy as np

model = crocoddyl.ActionModelLQR(1, 1)
model.u_lb, model.u_ub = np.array([-0.1]), np.array([0.1])
print("has_control_limits", model.has_control_limits)
for name in ("SolverDDP", "SolverFDDP", "SolverBoxDDP", "SolverBoxFDDP"):
    problem = crocoddyl.ShootingProblem(np.array([5.0]), [model] * 20, model)
    solver = getattr(crocoddyl, name)(problem)
    is_solved = solver.solve([], [], 100)
    print(name, is_solved, f"{max(abs(u[0]) for u in solver.us):.2f}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "crocoddyl 3.2.1"
echo "guess: each solver stays within 0.1, or refuses a model with limits"
echo "seen:  DDP and FDDP use 3.71, and say solved; those with Box in their names stay within 0.1"
diff - "$folder/seen" <<'SEEN'
has_control_limits True
SolverDDP True 3.71
SolverFDDP True 3.71
SolverBoxDDP True 0.10
SolverBoxFDDP True 0.10
SEEN
