"""`make release-check` refuses what a release must not be."""

import tarfile
import zipfile

import pytest
from scripts.release_check import problems_of_tag
from scripts.release_dist import Layout, build

PYPROJECT = b"""
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "cart"
version = "1.2.0"
readme = "README.md"
requires-python = ">=3.11"
license = "Apache-2.0"
license-files = ["LICENSE"]
[tool.hatch.build.targets.wheel]
packages = ["src/cart", "examples/starter"]
[tool.hatch.build.targets.wheel.sources]
"examples/starter" = "cart/starter"
[tool.hatch.build.targets.sdist]
only-include = ["src/cart", "examples/starter", "CHANGELOG.md"]
"""
FILES = {
    "pyproject.toml": PYPROJECT,
    "README.md": b"# cart\n",
    "LICENSE": b"text\n",
    "CHANGELOG.md": b"## 1.2.0\n",
    ".gitignore": b"runs/\nbuild/\ndist/\ntarget/\n__pycache__/\nCargo.lock\n.venv/\n",
    "src/cart/__init__.py": b"",
    "src/cart/py.typed": b"",
    "src/cart/assets/page.css": b"p {}\n",
    "examples/starter/scenario.yaml": b"name: cart\n",
    "tests/test_cart.py": b"",
}
WHEEL = {
    "cart/__init__.py": b"",
    "cart/py.typed": b"",
    "cart/assets/page.css": b"p {}\n",
    "cart/starter/scenario.yaml": b"name: cart\n",
    "cart-1.2.0.dist-info/METADATA": b"Name: cart\n",
}


def problems(folder, *, without=""):
    """Return what is wrong with WHEEL without a file."""
    path = folder / "cart-1.2.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name in WHEEL.keys() - {without}:
            archive.writestr(name, WHEEL[name])
    return list(Layout(FILES).problems_of_wheel(path))


def test_a_wheel_with_all_tracked_files_of_its_packages_passes(tmp_path):
    assert problems(tmp_path) == []


def test_a_wheel_without_a_file_is_refused(tmp_path):
    lacks = "cart/assets/page.css"
    assert problems(tmp_path, without=lacks) == [f"{lacks} is missing"]


def test_an_sdist_without_a_file_is_refused(tmp_path):
    path = tmp_path / "cart-1.2.0.tar.gz"
    with tarfile.open(path, "w:gz") as archive:
        for name in sorted({*FILES, "PKG-INFO"} - {"tests/test_cart.py", "LICENSE"}):
            archive.addfile(tarfile.TarInfo(f"cart-1.2.0/{name}"))
    assert list(Layout(FILES).problems_of_sdist(path)) == ["LICENSE is missing"]


@pytest.mark.slow
def test_a_project_builds_to_the_same_bytes_also_from_its_sdist(tmp_path):
    *_, problems = build(FILES, tmp_path, "1700000000", ".")
    assert problems == []


@pytest.mark.parametrize(
    ("tag", "changelog", "expected"),
    [
        ("v1.2.0", "## 1.2.0\n", []),
        ("v1.2.0", "## 1.2.0 (2026-12-01)\n", []),
        ("v1.2.0", "## Unreleased\n", ["CHANGELOG.md has no section `## 1.2.0`"]),
        ("v1.3.0", "## 1.2.0\n", ["the tag v1.3.0 is not v1.2.0, the version of pyproject.toml"]),
    ],
)
def test_a_tag_fits_the_version_and_the_changelog(tag, changelog, expected):
    assert list(problems_of_tag(tag, "1.2.0", changelog)) == expected
