"""`stepbus completion`: tried in the shells themselves."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.runs.terminal import STEPBUS
from support.tools import needs


@pytest.fixture(autouse=True)
def path(monkeypatch):
    """The script asks the `stepbus` on the path."""
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """Return what writes the script of a shell into a file, once."""
    folder = tmp_path_factory.mktemp("completion")

    def write(shell):
        path = folder / shell
        if not path.exists():
            done = subprocess.run(
                [*STEPBUS, "completion", shell], capture_output=True, check=True, timeout=60
            )
            path.write_bytes(done.stdout)
        return path

    return write


@pytest.fixture
def folder(tmp_path):
    for name in ("alone.mcap", "arm/run.mcap", "a.txt", "mine.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


CASES = [
    ("rer", ["rerun"]),
    ("run two_link/pi", ["two_link/pid"]),
    ("validate mi", ["mine.yaml"]),
    ("run two_link --transp", ["--transport"]),
    ("run two_link --transport ", ["tcp", "unix"]),
    ("completion z", ["zsh"]),
]
FILES = ("info a", ["a.txt", "alone.mcap", "arm"])


@pytest.mark.parametrize(("typed", "offered"), [*CASES, FILES])
def test_bash_completes(script, folder, typed, offered):
    needs("bash")
    lines = [
        f"source {script('bash')}",
        f"COMP_WORDS=(stepbus {typed}{' ' * typed.endswith(' ')})",
        "[[ $1 ]] && COMP_WORDS+=('')",
        "COMP_CWORD=$((${#COMP_WORDS[@]} - 1))",
        "_stepbus 2>/dev/null",
        'printf "%s\\n" "${COMPREPLY[@]}"',
    ]
    words = ["bash", "-c", "\n".join(lines), "bash", *(["x"] if typed.endswith(" ") else [])]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True, timeout=60)
    assert sorted(done.stdout.split()) == offered


@pytest.mark.parametrize(("typed", "offered"), CASES)
def test_fish_completes(script, folder, typed, offered):
    needs("fish")
    line = f"source {script('fish')}; complete -C 'stepbus {typed}'"
    done = subprocess.run(
        ["fish", "-c", line], cwd=folder, capture_output=True, text=True, check=True, timeout=60,
        env={**os.environ, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder)},
    )  # fmt: skip
    found = [row.partition("\t")[0] for row in done.stdout.splitlines() if row]
    assert sorted(found)[: len(offered)] == offered


ZSH = """
zmodload zsh/zpty
zpty shell zsh -f -i
zpty -w shell "PS1=; autoload -U compinit; compinit -u -D; eval \\"\\$(<$1)\\"; echo REA''DY"
zpty -r shell answer '*READY*'
zpty -w -n shell $'stepbus info alo\\t; echo DO\\'\\'NE\\n'
zpty -r shell answer '*DONE*'
print -r -- $answer
"""


def test_zsh_completes(script, folder):
    needs("zsh")
    words = ["zsh", "-f", "-c", ZSH, "zsh", str(script("zsh"))]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True, timeout=60)
    assert "stepbus info alone.mcap" in done.stdout
