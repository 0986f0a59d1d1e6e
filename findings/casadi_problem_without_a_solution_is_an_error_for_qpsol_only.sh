#!/usr/bin/env bash
# CasADi: an infeasible problem raises with qpsol and Opti, and returns a point with nlpsol.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet casadi==3.8.2 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import casadi

x = casadi.SX.sym("x")
problem = {"x": x, "f": x**2, "g": x}
quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0}
qp = {"print_iter": False, "print_header": False, "print_info": False}
bounds = {"x0": 0, "lbg": 1, "ubg": 1, "lbx": -0.5, "ubx": 0.5}
for name, solver in (
    ("nlpsol", casadi.nlpsol("solver", "ipopt", problem, quiet)),
    ("qpsol", casadi.qpsol("solver", "qrqp", problem, qp)),
):
    try:
        print(name, solver(**bounds)["x"], "success:", solver.stats()["success"])
    except RuntimeError:
        print(name, "raises RuntimeError")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "casadi 3.8.2"
echo "guess: x = 1 and |x| <= 0.5: both raise, or both return"
echo "seen:  nlpsol returns 0.5, with success: False in its statistics; qpsol raises (error_on_fail is on for it,"
echo "       and off for nlpsol)"
diff - "$folder/seen" <<'SEEN'
nlpsol 0.5 success: False
qpsol raises RuntimeError
SEEN
