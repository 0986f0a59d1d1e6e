"""The gallery shows everything that ships, as it was made last."""

from scripts.pictures import ENTRIES, PAGE, gallery, made_from
from support.paths import CHECKOUT

from stepbus_orchestrator.scenario.locate import builtin_names


def test_every_scenario_and_example_has_an_entry_once():
    runs = [entry.run for entry in ENTRIES]
    files = (CHECKOUT / "examples").rglob("scenario.yaml")
    named = {file.parent.relative_to(CHECKOUT).as_posix() for file in files}
    named.remove("examples/serial_motor")  # it waits for a motor on a serial port
    # These wait for a script.
    named = {name for name in named if not name.startswith("examples/coppelia/")}
    assert {run for run in runs if run.startswith("examples/")} == named
    assert set(builtin_names()) <= set(runs)
    assert len(set(runs)) == len(runs)


def test_the_page_is_the_one_that_the_list_and_the_runs_make():
    facts = made_from()
    assert facts.keys() >= {entry.name for entry in ENTRIES}
    assert PAGE.read_text(encoding="utf-8") == gallery(facts)
