import re
import tomllib

from support.paths import CHECKOUT

PROJECTS = [
    tomllib.loads((CHECKOUT / name).read_text(encoding="utf-8"))["project"]
    for name in ("pyproject.toml", "store/pyproject.toml")
]
DIRECT = {
    re.split(r"[<>=\[ ]", requirement)[0]
    for project in PROJECTS
    for group in (project["dependencies"], *project.get("optional-dependencies", {}).values())
    for requirement in group
    if not requirement.startswith("stepbus[")
}


def test_every_dependency_says_why_it_is_there() -> None:
    text = (CHECKOUT / "docs/dependencies.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)) == DIRECT | {"hatchling"}


def test_every_dependency_that_is_installed_by_us_is_pinned() -> None:
    pins = (CHECKOUT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    optional = {"example-robot-data"}
    assert DIRECT - optional <= {pin.partition("==")[0].lower() for pin in pins}
