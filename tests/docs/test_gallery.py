"""The gallery shows everything that ships, as it was made last."""

import importlib.util
import sys

import pytest
from support.paths import CHECKOUT

from stepbus_orchestrator.scenario.locate import builtin_names


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("gallery", CHECKOUT / "scripts/gallery.py")
    module = sys.modules["gallery"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["gallery"]


def test_every_scenario_and_example_has_an_entry_once(gallery):
    runs = [entry.run for entry in gallery.ENTRIES]
    files = (CHECKOUT / "examples").rglob("scenario.yaml")
    named = {file.parent.relative_to(CHECKOUT).as_posix() for file in files}
    named.remove("examples/serial_motor")  # it waits for a motor on a serial port
    assert {run for run in runs if run.startswith("examples/")} == named
    assert set(builtin_names()) <= set(runs)
    assert len(set(runs)) == len(runs)


def test_the_page_is_the_one_that_the_list_and_the_runs_make(gallery):
    facts = gallery.known_facts()
    assert facts.keys() == {entry.run for entry in gallery.ENTRIES}
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.page(facts)


def test_every_entry_has_its_picture_and_no_picture_is_left_over(gallery):
    pictures = {path.name for path in gallery.PICTURES.iterdir()} - {gallery.FACTS.name}
    assert pictures == {entry.picture.name for entry in gallery.ENTRIES}


def test_an_old_picture_is_found(gallery, tmp_path, monkeypatch):
    (entry,) = (one for one in gallery.ENTRIES if one.run == "two_link/pd")
    facts = gallery.known_facts()
    monkeypatch.setattr(gallery, "ENTRIES", (entry,))
    monkeypatch.setattr(gallery, "known_facts", lambda: {"two_link/pd": facts["two_link/pd"]})
    monkeypatch.setattr(gallery, "run", lambda _entry, _folder: {"messages": "others"})
    assert gallery.problems_of(tmp_path) == [
        "the picture of two_link/pd is older than what it shows"
    ]
    monkeypatch.setattr(gallery, "known_facts", dict)
    assert gallery.problems_of(tmp_path) == ["two_link/pd has no picture"]
