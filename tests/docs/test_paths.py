"""What the docs name exists."""

import re

import pytest
from support.paths import CHECKOUT

FOLDERS = ("docs", "scenarios", "store", "examples")
GLOBS = ("*.md", "benchmarks/*.md", *(f"{folder}/**/*.md" for folder in FOLDERS))
PAGES = sorted(p for glob in GLOBS for p in CHECKOUT.glob(glob) if "target" not in p.parts)
ROOTS = (
    "api", "benchmarks", "clients", "docs", "examples", "orchestrator", "participant", "scenarios",
    "schemas", "scripts", "services", "simulation", "tests", "tools", ".ci", "hosts",
    *(f"store/{name}" for name in ("docs", "schemas", "scripts", "stepbus_store", "tests")),
)  # fmt: skip
NAMED = re.compile(rf"`((?:{'|'.join(map(re.escape, ROOTS))})/[\w./*-]*)`")


def name_of(path):
    return str(path.relative_to(CHECKOUT))


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", h)) for h in headings]
    return {heading.strip().lower().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_to_a_file_and_a_heading(page):
    links = re.findall(
        r"\]\((?!https?://)([^)#\s]*)#?([^)\s]*)\)", page.read_text(encoding="utf-8")
    )
    targets = [(page.parent / path if path else page, anchor) for path, anchor in links]
    assert [str(path) for path, _ in targets if not path.exists()] == []
    assert [
        anchor
        for path, anchor in targets
        if anchor and path.suffix == ".md" and anchor not in anchors(path)
    ] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_path_that_a_page_names_exists(page):
    named = NAMED.findall(page.read_text(encoding="utf-8"))
    assert [path for path in named if not list(CHECKOUT.glob(path.rstrip("/")))] == []


def test_every_module_that_the_map_names_exists():
    page = (CHECKOUT / "docs/architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w/]+\.py)`", page))
    modules = {
        f"/{path.relative_to(CHECKOUT)}"
        for root in ROOTS
        for path in (CHECKOUT / root).rglob("*.py")
    }
    assert [n for n in named if not any(path.endswith(f"/{n}") for path in modules)] == []
