"""The budget of lines holds, and can fail."""

import subprocess
import sys

import pytest
from support.paths import CHECKOUT
from support.tools import needs

SCRIPT = CHECKOUT / "scripts/check_budget.py"


@pytest.fixture
def project(tmp_path):
    """Return a function that checks a package of 100 lines against a budget: exit code and text."""
    needs("git")
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    (tmp_path / "core").mkdir()
    (tmp_path / "core/code.py").write_text("x = 1\n" * 100)
    (tmp_path / "core/data.json").write_text("{}\n" * 100)

    def check(lines):
        entry = f'core = {{folders = ["core"], lines = {lines}}}'
        (tmp_path / "pyproject.toml").write_text(f"[tool.budget]\n{entry}\n")
        done = subprocess.run(
            [sys.executable, SCRIPT], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout

    return check


@pytest.mark.parametrize("lines", [100, 105])
def test_a_package_within_its_budget_passes(project, lines):
    assert project(lines) == (0, f"core              100 of {lines:6}\n")


def test_a_package_above_its_budget_fails(project):
    code, text = project(99)
    assert (code, "1 lines too many" in text) == (1, True)


def test_a_package_far_below_its_budget_lowers_it(project):
    code, text = project(106)
    assert (code, "lower its entry in pyproject.toml to 100" in text) == (1, True)
