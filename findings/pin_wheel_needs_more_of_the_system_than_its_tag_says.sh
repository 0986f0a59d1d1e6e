#!/usr/bin/env bash
# pin (Pinocchio): the wheel is tagged manylinux_2_28, but needs OpenMP of the system and symbols of glibc 2.34.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet auditwheel==6.4.2 packaging==25.0 pyelftools==0.32
"$folder/venv/bin/pip" download --quiet --no-deps --only-binary :all: --python-version 3.11 \
    --platform manylinux_2_28_x86_64 --dest "$folder/wheels" pin==4.1.0
wheel=$(echo "$folder"/wheels/pin-4.1.0-*.whl)
"$folder/venv/bin/auditwheel" show "$wheel" | tr '\n' ' ' > "$folder/shown"
{
    echo "tag $(basename "$wheel" .whl | sed 's/.*-//')"
    grep -o 'consistent with the following platform tag: "[a-z_0-9]*"' "$folder/shown"
    grep -o 'libgomp.so.1 with versions' "$folder/shown"
    grep -o 'constrains the platform tag to "[a-z_0-9]*"' "$folder/shown"
} | tee "$folder/seen"
echo "pin 4.1.0, auditwheel 6.4.2"
echo "guess: a wheel tagged manylinux_2_28 runs wherever pip installs it, with glibc 2.28 and nothing else"
echo "seen:  consistent with linux_x86_64 only: libgomp.so.1 must be there (a bare Debian 12 lacks it:"
echo "       ImportError; apt-get install libgomp1), and glibc 2.34, not 2.28"
diff - "$folder/seen" <<'SEEN'
tag manylinux_2_28_x86_64
consistent with the following platform tag: "linux_x86_64"
libgomp.so.1 with versions
constrains the platform tag to "manylinux_2_34_x86_64"
SEEN
