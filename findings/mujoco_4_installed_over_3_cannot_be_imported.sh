#!/usr/bin/env bash
# mujoco: `pip install mujoco==4.0.0` over 3.3.7 leaves a package that cannot be imported; `pip check` finds nothing wrong.
# 4.0.0 is split: pip unpacks mujoco-core into the folder of the old package, and then removes the old package's files.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
cd "$folder"
import() { venv/bin/python -c 'import mujoco; print(mujoco.__version__)' 2>&1 | grep -oE '^[0-9.]+$|ImportError' | head -1 || true; }
{
  venv/bin/pip install --quiet mujoco==3.3.7
  import
  venv/bin/pip install --quiet mujoco==4.0.0
  import
  venv/bin/pip check
  venv/bin/pip install --quiet --force-reinstall --no-deps mujoco==4.0.0 mujoco-core==4.0.0
  import
} | tee seen
echo "mujoco 3.3.7, then 4.0.0 with mujoco-core 4.0.0"
echo "guess: an upgrade in place works, as of any wheel"
echo "seen:  ImportError until both are installed again; the error itself names this command"
printf '3.3.7\nImportError\nNo broken requirements found.\n4.0.0\n' | cmp - seen
