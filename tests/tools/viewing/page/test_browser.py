"""The page of a run in a browser: what is drawn, what a visitor can do with it."""

import numpy as np
import pytest
from support.browser import needs_chromium, opened, picture
from support.pages import STEPS, save_result, write_recording

from stepbus_tools.theme import LINES
from stepbus_tools.viewing.page import write_page

pytestmark = [pytest.mark.slow, needs_chromium]

END = (STEPS - 1) / 100
READ = """() => [...charts.values()].map(plot => ({
    points: plot.data.slice(1).map(row => row.filter(y => y !== null).length),
    x: [plot.scales.x.min, plot.scales.x.max],
    ink: (() => {
        const {width, height} = plot.ctx.canvas;
        const bytes = plot.ctx.getImageData(0, 0, width, height).data;
        return bytes.filter((value, index) => index % 4 === 3 && value > 0).length;
    })(),
}))"""
HIDDEN = "all => all.filter(one => one.getBoundingClientRect().height < 20).length"


def pixels(locator):
    """Return what an element looks like, shape (rows, columns, 3)."""
    return np.asarray(picture(locator)).astype(int)


def near(picture, color):
    """Return where a picture has a colour, shape (rows, columns)."""
    wanted = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)])
    return np.abs(picture - wanted).max(axis=2) < 40


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_opens_offline_and_its_charts_zoom_together(recording, width, dark):
    with opened(write_page([recording]).as_uri(), width=width, height=2000) as watched:
        page = watched.page
        page.emulate_media(color_scheme="dark" if dark else "light")
        assert page.locator(".thumb").evaluate_all(HIDDEN) == 0
        for number in range(3):
            page.locator(".cell summary").nth(number).click()

        def drawn():
            plots = page.evaluate(READ)
            return len(plots) == 3 and all(plot["ink"] > 1000 for plot in plots)

        def shows(first, last):
            ends = [plot["x"] for plot in page.evaluate(READ)]
            return all(end == pytest.approx([first, last], abs=0.05) for end in ends)

        watched.wait(drawn, "charts")
        assert all(sum(plot["points"]) >= STEPS for plot in page.evaluate(READ))
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.locator(".chart .u-over").first.scroll_into_view_if_needed()
        box = page.locator(".chart .u-over").first.bounding_box()
        middle = box["y"] + box["height"] / 2
        page.mouse.move(box["x"] + box["width"] / 4, middle)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2, middle, steps=5)
        page.mouse.up()
        watched.wait(lambda: shows(END / 4, END / 2), "the zoom by dragging")
        page.fill("#from", "1")
        page.fill("#to", "2")
        page.dispatch_event("#to", "change")
        watched.wait(lambda: shows(1, 2), "the zoom of all charts")
        page.click("#all")
        watched.wait(lambda: shows(0, END), "the whole run in all charts")
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert background == ("rgb(20, 25, 31)" if dark else "rgb(255, 255, 255)")
    assert (watched.errors, watched.strangers) == ([], [])


def test_what_ended_a_run_is_a_red_line_with_its_word_at_its_time(recording, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(recording.read_bytes())
    save_result(tmp_path, at_step=STEPS, steps=STEPS)
    with opened(write_page([path]).as_uri(), width=1280, height=900) as watched:
        page = watched.page
        cell = page.locator(".cell").first
        end = page.evaluate("report.end")
        assert end > STEPS / 100
        cell.locator("summary").click()
        watched.wait(lambda: len(page.evaluate(READ)) == 1, "the chart")
        shown = pixels(cell.locator(".chart canvas").first)
        column = np.argmax(near(shown, "#c0262d").sum(axis=0))
        over = cell.locator(".chart .u-over").first.bounding_box()
        left = over["x"] - page.locator(".chart canvas").first.bounding_box()["x"]
        assert (column - left) / over["width"] * end == pytest.approx(STEPS / 100, abs=0.02)


def test_on_paper_every_curve_is_there(recording):
    with opened(write_page([recording]).as_uri(), width=1000, height=600) as watched:
        page = watched.page
        count = page.locator(".thumb").count()
        assert count > 8
        page.locator(".cell summary").first.click()
        page.emulate_media(media="print")
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.locator(".thumb canvas").count() == count
        assert len(page.pdf()) > 20_000
        assert near(pixels(page.locator(".thumb").nth(1)), LINES[0]).sum() > 100


def test_a_filter_keeps_what_has_all_its_words(recording):
    with opened(write_page([recording]).as_uri(), width=1280, height=900) as watched:
        page = watched.page

        def left():
            return page.locator(".cell:visible .name").all_text_contents()

        # Folded, it says which line is which; those of joints are told by their titles.
        legends = page.locator(".cell .legend").all_text_contents()
        assert "left" in legends[-1]
        assert not any("hip" in one for one in legends)
        every = left()
        page.fill("#filter", "KNEE pos")
        watched.wait(lambda: left() == ["position [rad]"], "one chart")
        page.fill("#filter", "odometry")
        watched.wait(lambda: "yaw [rad]" in left(), "the charts of a port")
        assert "position [rad]" not in left()
        page.fill("#filter", "")
        watched.wait(lambda: left() == every, "all charts")
        page.locator(".cell summary").first.click()
        page.click("#unit")
        watched.wait(lambda: page.inner_text("#unit") == "show radians", "degrees")
        assert not watched.errors


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(recording, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    with opened(write_page([recording]).as_uri(), width=1280, height=900) as watched:
        watched.page.emulate_media(color_scheme=scheme)
        watched.page.locator(".cell summary").first.click()
        watched.wait(lambda: len(watched.page.evaluate(READ)) == 1, "the chart")
        found = axe.run(watched.page).response["violations"]
        assert [(one["id"], one["nodes"][0]["html"]) for one in found] == []


def test_in_a_comparison_a_run_has_a_line_style_and_a_joint_its_colour(recording, tmp_path):
    (tmp_path / "other").mkdir()
    other = write_recording(tmp_path / "other" / "run.mcap")
    target = write_page([recording, other], tmp_path / "both.html")
    with opened(target.as_uri(), width=1280, height=900) as watched:
        looks = watched.page.locator(".cell[data-name='knee position']").evaluate(
            "cell => chartOf(cell).lines.map(look).map(one => [one.stroke(), one.dash])"
        )
        assert [stroke for stroke, _ in looks] == ["#e8480c"] * 2
        assert looks[1][1] == [6, 3]
        names = watched.page.locator("#curves > .runs span").all_text_contents()
        assert names == [recording.parent.name, "other"]


def test_the_scene_in_motion_is_in_the_page_and_asks_nobody(plain_run):
    target = write_page([plain_run.recording], has_replay=True)
    with opened(target.as_uri(), width=1280, height=900) as watched:
        page = watched.page
        page.locator(".replay summary").click()
        frame = page.frame_locator(".replay iframe")
        watched.wait(lambda: frame.locator("canvas").count() > 0, "the scene")
        watched.wait(
            lambda: len(np.unique(pixels(frame.locator("canvas").first))) > 20, "the robot"
        )
    assert (watched.errors, watched.strangers) == ([], [])
