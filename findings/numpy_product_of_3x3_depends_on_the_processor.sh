#!/usr/bin/env bash
# NumPy: a product of two 3×3 matrices, its inverse and a 7×7 solution have other last bits on another
# processor (OpenBLAS chooses its kernels by it); einsum, cross, sums, sin and exp have the same.
set -euo pipefail
grep -q avx2 /proc/cpuinfo || { echo "needs a processor with AVX2, to compare both kernels"; exit 77; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import hashlib

import numpy as np

rng = np.random.default_rng(0)
a, v = rng.normal(size=(1000, 3, 3)), rng.normal(size=(1000, 3))
b, big, right = a.transpose(0, 2, 1), rng.normal(size=(200, 7, 7)), rng.normal(size=(200, 7))
results = {
    "product 3x3": [x @ y for x, y in zip(a, b)],
    "product of 3x3 and vector": [x @ y for x, y in zip(a, v)],
    "inverse 3x3": [np.linalg.inv(x) for x in a],
    "solve 7x7": [np.linalg.solve(x, y) for x, y in zip(big, right)],
    "einsum 3x3": np.einsum("nij,njk->nik", a, b),
    "cross": np.cross(v, v[::-1]),
    "sum": big.sum(axis=(1, 2)),
    "sin, exp": np.concatenate([np.sin(v), np.exp(v)]),
}
for name, values in results.items():
    print(name, hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()[:12], sep="|")
PYTHON
for core in Nehalem Haswell; do
    OPENBLAS_NUM_THREADS=1 OPENBLAS_CORETYPE=$core "$folder/venv/bin/python" "$folder/try.py" > "$folder/$core"
done
join -t'|' --nocheck-order "$folder/Nehalem" "$folder/Haswell" | awk -F'|' '{print $1 ": " ($2 == $3 ? "same bits" : "other bits")}' | tee "$folder/seen"
echo "numpy 2.4.6, its own OpenBLAS, with the kernels of a processor with SSE only and of one with AVX2"
echo "guess: matrices as small as 3x3 are multiplied by NumPy itself, with the same bits everywhere"
echo "seen:  every product goes through OpenBLAS; einsum and elementwise functions do not"
cat > "$folder/expected" <<'END'
product 3x3: other bits
product of 3x3 and vector: other bits
inverse 3x3: other bits
solve 7x7: other bits
einsum 3x3: same bits
cross: same bits
sum: same bits
sin, exp: same bits
END
cmp "$folder/expected" "$folder/seen"
