#!/usr/bin/env bash
# cma: the seed 0 means the clock, so two searches with seed 0 differ; every other seed repeats itself.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cma==4.5.0
cat > "$folder/try.py" <<'PYTHON'
import cma


def first_points(seed):
    search = cma.CMAEvolutionStrategy([0.0, 0.0], 1.0, {"seed": seed, "verbose": -9})
    return [list(point) for point in search.ask()]


for seed in (0, 1):
    print(seed, "same" if first_points(seed) == first_points(seed) else "other")
PYTHON
(cd "$folder" && venv/bin/python -W ignore try.py 2>stderr) | tee "$folder/seen"
echo "cma 4.5.0"
echo "guess: each seed, 0 too, proposes the same points twice"
echo "seen:  seed 0 proposes others each time"
printf '0 other\n1 same\n' | cmp - "$folder/seen"
