#!/usr/bin/env bash
# coal: `penetration_depth` of a contact is a signed distance: negative where shapes overlap, positive in the margin.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet coal==3.0.3
cat > "$folder/collide.py" <<'PYTHON'
import coal
import numpy as np

box = coal.Box(1.0, 1.0, 1.0)
for distance in (0.9, 1.05):
    there = coal.Transform3s.Identity()
    there.setTranslation(np.array([distance, 0.0, 0.0]))
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = 0.1
    coal.collide(box, coal.Transform3s.Identity(), box, there, request, result)
    print(distance, round(result.getContact(0).penetration_depth, 6))
PYTHON
"$folder/venv/bin/python" "$folder/collide.py" | tee "$folder/seen"
echo "coal 3.0.3"
echo "guess: boxes that overlap by 0.1 have the depth 0.1, those 0.05 apart -0.05"
echo "seen:  -0.1 and 0.05"
printf '0.9 -0.1\n1.05 0.05\n' | cmp - "$folder/seen"
