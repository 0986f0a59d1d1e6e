#!/usr/bin/env bash
# ProxQP: a problem with one variable is 'solved' far from its minimum: whether the multipliers fit is not checked.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet proxsuite==0.8.0 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
import proxsuite

# 0.5 x² - 0.3 x falls up to 0.3.
for bounds in ([0.01], [0.01, 0.25]):
    for checks_gap in (False, True):
        count, above = len(bounds), np.array(bounds)
        problem = proxsuite.proxqp.dense.QP(1, 0, count)
        problem.init(np.eye(1), np.array([-0.3]), None, None, np.ones((count, 1)), -above, above)
        problem.settings.check_duality_gap = checks_gap
        problem.solve()
        status = str(problem.results.info.status).partition("PROXQP_")[2]
        x = problem.results.x[0]
        found = "x = 0.010" if abs(x - 0.01) < 1e-4 else "x is another one"
        print(f"|x| <= {bounds}, check_duality_gap {checks_gap}: {status}, {found}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "proxsuite 0.8.0"
echo "guess: x = 0.010 each time, to the default accuracy of 1e-5: the second bound changes nothing"
echo "seen:  with the second bound, x = -0.006 here, SOLVED: it is stationary and within the bounds, but with a"
echo "       multiplier of a bound that does not hold it; check_duality_gap, which is off, goes on to 0.010. An"
echo "       inverse kinematics of Pink (solver proxqp) stands still with it. The same in 0.6.7 to 0.7.2"
diff - "$folder/seen" <<'SEEN'
|x| <= [0.01], check_duality_gap False: SOLVED, x = 0.010
|x| <= [0.01], check_duality_gap True: SOLVED, x = 0.010
|x| <= [0.01, 0.25], check_duality_gap False: SOLVED, x is another one
|x| <= [0.01, 0.25], check_duality_gap True: SOLVED, x = 0.010
SEEN
