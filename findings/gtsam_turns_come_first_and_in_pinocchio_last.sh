#!/usr/bin/env bash
# GTSAM and Pinocchio: the same pose has its six numbers in another order; GTSAM's turn comes first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gtsam==4.3.0 pin==4.1.0 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import gtsam
import numpy as np
import pinocchio

pose = pinocchio.exp6(pinocchio.Motion(np.array([1, 2, 3, 0.1, 0.2, 0.3])))
print("pinocchio", pinocchio.log6(pose).vector.round(6).tolist())
print("gtsam", gtsam.Pose3.Logmap(gtsam.Pose3(pose.homogeneous)).round(6).tolist())
sigmas = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, 0.01, 1.0, 1.0, 1.0]))
moved = gtsam.Pose3(gtsam.Rot3(), np.array([1.0, 0.0, 0.0]))
prior = gtsam.PriorFactorPose3(0, gtsam.Pose3(), sigmas)
values = gtsam.Values()
values.insert(0, moved)
print("error of 1 m with sigmas of 0.01 first:", round(prior.error(values), 6))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "gtsam 4.3.0, pin 4.1.0"
echo "guess: both have the translation first; with sigmas of 0.01 first, 1 m is an error of 5,000"
echo "seen:  GTSAM has the turn first, in logarithms, Jacobians and noise models: the error is 0.5"
diff - "$folder/seen" <<'SEEN'
pinocchio [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
gtsam [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]
error of 1 m with sigmas of 0.01 first: 0.5
SEEN
