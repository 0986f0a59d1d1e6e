"""What a user orders on the page of a run."""

import pytest
from support.browser import needs_chromium, opened
from support.paused import Paused, calls_of, followed
from support.runs.patience import patient

from stepbus_orchestrator.scenario.load import load


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(600)
def test_an_item_is_ordered_from_the_store_on_the_page(tmp_path, page):
    paused = Paused(tmp_path / "run", load("store", patient("store", "duration=160ms")))
    with opened(page.address, 400, 300) as watched, followed(paused, page):
        shown = watched.page
        paused.pace.step(3)
        watched.wait(lambda: shown.get_by_text("step 3 of").count() > 0, "step 3")
        shown.get_by_role("tab", name="Steer").press("Enter")
        watched.wait(lambda: shown.get_by_text("place order").count() > 0, "what can be ordered")
        shown.get_by_role("button", name="place order").press("Enter")
        watched.wait(lambda: shown.get_by_text("mission order cola").count() > 0, "the order")
        shown.get_by_role("button", name="resume").press("Enter")
        watched.wait(lambda: not paused.thread.is_alive(), "the run to end")
        assert not watched.errors
    assert calls_of(paused.result) == [("order", "cola")]
