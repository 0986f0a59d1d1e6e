import re
import tomllib

from support.paths import CHECKOUT

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DIRECT = {
    re.split(r"[<>=\[ ]", requirement)[0]
    for group in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
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
