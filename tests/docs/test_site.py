"""The site that `make docs` builds."""

import inspect
import re
import subprocess
import sys

import pytest
from support.paths import CHECKOUT

import stepbus

pytest.importorskip("sphinx", reason="needs the extra docs: `make docs`")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
LOADED = re.compile(
    r'<(?:script|img|link|iframe|source)\b[^>]*\b(?:src|href)="((?:https?:)?//[^"]*)"'
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the built site."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-E", "-d", out / "doctrees"]
    done = subprocess.run(
        [*command, "-c", "docs/site", ".", out / "html"],
        cwd=CHECKOUT, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return out / "html"


def test_every_public_name_is_in_the_reference(site):
    anchors = set(
        re.findall(r'id="(stepbus\.[\w.]+)"', (site / "docs/reference/api.html").read_text())
    )
    modules = [
        getattr(stepbus, name)
        for name in stepbus.__all__
        if inspect.ismodule(getattr(stepbus, name))
    ]
    public = {
        f"stepbus.{name}" for name in stepbus.__all__ if getattr(stepbus, name) not in modules
    }
    others = {
        f"{module.__name__}.{name}"
        for module in modules
        for name in module.__all__
        if name not in stepbus.__all__
    }
    assert public | others <= anchors


def test_no_page_loads_anything_from_another_host(site):
    pages = {page: page.read_text() for page in site.rglob("*.html")}
    assert len(pages) > 25
    assert [url for text in pages.values() for url in LOADED.findall(text)] == []
    styles = [style.read_text() for style in site.rglob("*.css")]
    assert [
        url for text in styles for url in re.findall(r"(?:url\(|@import )['\"]?https?:[^)]*", text)
    ] == []
