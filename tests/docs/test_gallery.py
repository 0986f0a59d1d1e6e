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
