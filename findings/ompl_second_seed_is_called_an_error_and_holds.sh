#!/usr/bin/env bash
# OMPL: a seed that is set after the first draw is said to be of no effect, but holds; a second 0 does not.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ompl==2.0.1
cat > "$folder/try.py" <<'PYTHON'
import sys

from ompl import util


def draw(seed):
    util.RNG.setSeed(seed)
    return round(util.RNG().uniform01(), 4)


for seeds in ((1, 2, 1), (0, 0)):
    sys.stdout.flush()
    print(*seeds, ":", *(draw(seed) for seed in seeds))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "ompl 2.0.1"
echo "guess: as the message says: 'Changing seed now will not lead to deterministic sampling'"
echo "seen:  each seed gives its own numbers, also later; 0 first counts on"
diff - "$folder/seen" <<'SEEN'
1 2 1 : 0.2399 0.7603 0.2399
0 0 : 0.7074 0.4292
SEEN
