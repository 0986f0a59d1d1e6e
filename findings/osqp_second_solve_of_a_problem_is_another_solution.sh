#!/usr/bin/env bash
# OSQP: a solver that solves its problem twice gives two solutions, 1e-4 apart: the second starts where
# the first ended. New solvers give the same bits each. A controller that keeps its solver depends on
# all problems before.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet osqp==1.1.3 numpy==2.4.6 scipy==1.17.1
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

import numpy as np
import osqp
from scipy import sparse

N, M = 40, 60
rng = np.random.default_rng(0)
COST = sparse.csc_matrix(np.diag(np.linspace(0.01, 10, N)))
LINEAR = rng.normal(size=N)
ROWS = sparse.csc_matrix(rng.normal(size=(M, N)))


def solver():
    made = osqp.OSQP()
    made.setup(COST, LINEAR, ROWS, -np.ones(M), np.full(M, 0.5), verbose=False)
    return made


def solution(of):
    result = of.solve()
    assert result.info.status == "solved"
    return result.x.copy()


kept = solver()
first, second = solution(kept), solution(kept)
new = [solution(solver()) for _ in range(5)]
apart = np.abs(first - second).max()
print(f"osqp {version('osqp')}")
print("guess: the same problem has the same solution, to the bit")
print(f"seen: new solvers agree to the bit: {all((x == first).all() for x in new)}")
print(f"seen: the second solution of one solver is {apart:.0e} away from the first")
sys.exit(not (all((x == first).all() for x in new) and 1e-6 < apart < 1e-2))
PYTHON
