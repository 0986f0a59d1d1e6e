#!/bin/sh
# Install stepbus with some extras of pyproject.toml into .venv, at the versions of constraints.txt.
# Does nothing if they are there. POSIX sh: not every machine has bash. Argument: their names; default: dev, all.
# PYTHON3: the Python to create it with; default: python3.11 or python3.
set -eu
cd "$(dirname "$0")/.."

venv=.venv
extras=${1:-dev}
full=$venv/.stepbus-installed
if [ "$extras" = dev ]; then stamp=$full; else stamp=$full-$extras; fi

wanted=${PYTHON3:-}
if [ -n "$wanted" ]; then set -- "$wanted"; else set -- python3.11 python3; fi

version_of() { "$1" -c 'import sys; print(sys.version)' 2>/dev/null; }

is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

if [ -n "$wanted" ]; then
    if ! is_new_enough "$wanted"; then
        echo "PYTHON3=$wanted does not run, or is older than Python 3.11; give its name or path" >&2
        exit 1
    fi
    if [ -e "$venv" ] && [ "$(version_of "$wanted")" != "$(version_of "$venv/bin/python")" ]; then
        rm -rf "$venv"
    fi
fi

# A stamp names the folder: in a copied one, .venv would still run the code of the original.
is_newest() { [ "$(cat "$1" 2>/dev/null)" = "$PWD" ] && [ "$1" -nt pyproject.toml ] && [ "$1" -nt constraints.txt ]; }
if { is_newest "$stamp" || is_newest "$full"; } && "$venv/bin/python" -c '' 2>/dev/null; then
    exit 0
fi

if ! is_new_enough "$venv/bin/python"; then
    python=
    for candidate in "$@"; do
        if is_new_enough "$candidate"; then python=$candidate; break; fi
    done
    if [ -z "$python" ]; then
        echo "stepbus needs Python 3.11 or newer, but finds neither python3.11 nor a new enough python3:" \
            "install it (e.g. the packages python3.11 and python3.11-venv) and try again" >&2
        exit 1
    fi
    echo "creating $venv with $("$python" --version)"
    if ! "$python" -m venv --clear "$venv"; then
        rm -rf "$venv"
        echo "$python cannot create a virtual environment; on Debian and Ubuntu install" \
            "the package python3.11-venv and try again" >&2
        exit 1
    fi
fi

# The wheel of Pinocchio leaves OpenMP to the system; the smallest images lack it.
if ! "$venv/bin/python" -c 'import ctypes; ctypes.CDLL("libgomp.so.1")' 2>/dev/null; then
    echo "Pinocchio needs the library libgomp.so.1: install the package libgomp1 (Debian, Ubuntu)" \
        "or libgomp (Fedora) and try again" >&2
    exit 1
fi

if ! "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info >= (3, 12))'; then
    echo "note: PyBullet has no wheel for $("$venv/bin/python" --version); the plant uses MuJoCo"
fi

if [ "$extras" = dev ]; then lasts="1 to 2 minutes"; else lasts="half a minute"; fi
echo "installing stepbus[$extras] into $venv ($lasts, only once)"
# A terminal shows one line, which changes; elsewhere the log has them all.
up=$(printf '\033[A\033[K') found=d
if [ -t 1 ]; then found="s/^Collecting \([^ <>=~!]*\).*/$up  found \1/p"; echo; fi
log=$venv/setup.log
failed=$venv/setup.failed  # a pipe has the exit code of its last command only
rm -f "$failed"
{
    "$venv/bin/python" -m pip install --disable-pip-version-check --progress-bar off \
        -c constraints.txt -e ".[$extras]" 2>&1 || touch "$failed"
} | tee "$log" |
    sed -u -n -e "$found"
if [ -e "$failed" ]; then
    tail -n 15 "$log" >&2
    echo "installation failed; the full output is in $log" >&2
    exit 1
fi
pwd >"$stamp"
echo "ready"
