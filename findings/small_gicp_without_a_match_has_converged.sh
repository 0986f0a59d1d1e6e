#!/usr/bin/env bash
# small_gicp: point clouds of which no point finds a partner are aligned: converged, error 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet small_gicp==1.0.1 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
import small_gicp

target = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
for shift in (0.5, 5.0):
    source = target - [shift, 0, 0]
    found = small_gicp.align(target, source, registration_type="ICP", downsampling_resolution=0.01)
    moved = float(found.T_target_source[0, 3].round(6))
    print(shift, found.converged, found.num_inliers, moved, round(found.error, 6))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "small_gicp 1.0.1"
echo "guess: clouds that are 5 m apart, beyond the default distance of 1 m: not converged, or an error"
echo "seen:  converged, error 0, the identity; only num_inliers, 0, tells"
diff - "$folder/seen" <<'SEEN'
0.5 True 2000 0.5 0.0
5.0 True 0 0.0 0.0
SEEN
