"""What visitors of a page find: keys, marks, colours, names, and the robot in sight."""

import contextlib
import itertools
import math

import numpy as np
import pytest
from support.browser import Curves, needs_chromium, opened, picture

from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.viewing.door import open_page
from stepbus_tools.viewing.playback import Playback, open_recording
from stepbus_tools.viewing.scene.meshes import Visual, primitive
from stepbus_tools.viewing.scene.scene import Frame, Scene
from stepbus_tools.viewing.stage.stage import add_light, drawn, free_part
from stepbus_tools.viewing.viewpoint import Swept, framed

BOX = np.array([-0.5, 0.0, 0.0]), np.array([0.5, 0.4, 1.2])
RED = (200, 30, 30)


def record(folder, *overrides):
    scenario = load("two_link", ["duration=300ms", *overrides])
    return run(scenario, Options(out=folder, host=InProcess())).recording


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("visitors")
    return record(folder / "soft", "controller.params.kp=90"), record(folder / "stiff")


@pytest.fixture
def page():
    page = open_page("a run <1>")
    yield page
    page.close()


@contextlib.contextmanager
def visited(page, recordings, **options):
    """Yield a page of two recordings in a browser, and what waits for something on it."""
    playback = Playback(page.server, *map(open_recording, recordings))
    with opened(page.address, **options) as watched:

        def wait(is_done, what="the page"):
            watched.wait(lambda: (playback.turn(0.1), is_done())[1], what)

        wait(lambda: says(watched.page, "step 0 of 60"))
        yield watched, wait


def says(page, text):
    return page.get_by_text(text).count() > 0


# --- without a browser ------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1280, 800), (390, 844), (2560, 1440), (640, 360)])
def test_a_camera_sees_the_whole_box_in_the_free_part_and_fills_it(size):
    fov, (width, height) = 1.0, size
    view = framed(BOX, aspect=width / height, fov=fov, free=free_part(*size))
    position, look_at = view.eye, view.target
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    corners = np.array(list(itertools.product(*zip(*BOX, strict=True)))) - position
    depth = corners @ forward * math.tan(fov / 2)
    x, y = corners @ right / depth / (width / height), corners @ np.cross(right, forward) / depth
    (left, end), (bottom, top) = free_part(*size)
    spans = [(x.min() - left, end - x.max()), (y.min() - bottom, top - y.max())]
    assert min(map(min, spans)) > -1e-6
    assert any(max(span) < 1e-3 for span in spans)


def test_what_moves_is_framed_and_what_stands_is_not():
    mesh = primitive("box", (0.2, 0.2, 0.2))
    look = (Visual(mesh=mesh),)
    frames = [Frame(name=name, body=name, visuals=look) for name in ("arm", "far")]
    places = {"arm": 0.0, "far": 9.0}

    class Moving(Scene):
        def world_poses(self, _messages):
            from stepbus_tools.viewing.scene.pose import Pose  # noqa: PLC0415

            return {name: Pose((x, 0.0, 0.0)) for name, x in places.items()}

    swept = Swept(Moving(frames=frames))
    swept.take({})
    assert (swept.box[1][0], len(swept.fixed)) == (pytest.approx(9.1), 0)
    places["arm"] = 1.0
    swept.take({})
    assert (swept.box[0][0], swept.box[1][0]) == pytest.approx((-0.1, 1.1))
    assert swept.fixed[:, :, 0].tolist() == [pytest.approx([8.9, 9.1])]


# --- with a browser ---------------------------------------------------------------------------


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_keys_step_play_and_jump_and_the_playhead_follows(page, recordings):
    with visited(page, recordings, width=1100) as (watched, wait):
        shown, keys, curves = watched.page, watched.page.keyboard, Curves(watched)
        assert shown.title() == "a run <1> · stepbus"
        shown.get_by_role("tab", name="Curves").click()
        wait(lambda: curves.has(
            "joint1 · soft", "joint2 · soft", "joint1 · stiff", "joint2 · stiff",
        ), "both recordings, named")  # fmt: skip
        # A button that has the focus leaves all keys alone but those that press it.
        shown.get_by_text("last »", exact=True).click()
        for key, step in (("End", 60), ("ArrowLeft", 59), ("Home", 0), ("ArrowRight", 1)):
            keys.press(key)
            wait(lambda step=step: says(shown, f"step {step} of 60"), key)
        wait(lambda: curves.lines("now") == pytest.approx([0.005]), "the playhead")
        shown.mouse.click(300, 500)
        keys.press("Space")
        wait(lambda: says(shown, "step 60 of 60"), "the end")
        # What has the focus keeps its keys: the slider moves, and no key steps as well.
        slider = shown.get_by_role("slider", name="time [s]")
        slider.press("Home")
        wait(lambda: says(shown, "step 0 of 60"), "the start by the slider")
        slider.press("ArrowRight")
        wait(lambda: says(shown, "step 1 of 60"), "one step by the slider")
        wait(lambda: len(curves.lines("line")) == 1, "the first divergence in the curves")
    assert (watched.errors, watched.strangers) == ([], [])


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_on_a_phone_the_controls_are_below_and_the_robot_above(page, recordings):
    options = {"width": 390, "height": 844, "scheme": "dark"}
    with visited(page, recordings, **options) as (watched, wait):

        def pixels():
            return np.asarray(picture(watched.page), dtype=int)

        def robot():
            # The ghost of the second recording is orange, and nothing else is.
            red, _, blue = np.moveaxis(pixels()[:422], 2, 0)
            return np.argwhere(red - blue > 60)

        watched.page.locator(".mantine-Notification-closeButton").click()
        wait(lambda: len(robot()) > 100, "the robot")
        assert 20 < robot()[:, 0].min() < robot()[:, 0].max() < 415
        panel = watched.page.get_by_role("slider", name="time [s]").bounding_box()
        assert panel["y"] > 422
        assert watched.page.get_by_role("tab", name="Curves").bounding_box()["x"] < 195
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= 390
        assert pixels()[:200].mean() < 60


def resize(watched, wait, width):
    """Resize a page in two goes: viser tells its canvas' size as soon as that changes, which may be
    before the canvas has it, and then says nothing more; the second go is told with the new width.
    """
    width_of = "() => document.querySelector('canvas[data-engine]').width"
    watched.page.set_viewport_size({"width": width, "height": 600})
    wait(lambda: watched.page.evaluate(width_of) == width, "the canvas")
    watched.page.set_viewport_size({"width": width, "height": 601})


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_the_camera_refits_until_somebody_moves_it(page, recordings):
    with visited(page, recordings, width=1000) as (watched, wait):
        (client,) = page.server.get_clients().values()

        def eye():
            return np.round(client.camera.position, 3).tolist()

        wait(lambda: client.camera.image_width == 1000 and eye() != [3.0, 3.0, 3.0])
        before = eye()
        resize(watched, wait, 700)
        wait(lambda: client.camera.image_width == 700, "the size")
        wait(lambda: eye() != before, "another place for another size")
        moved, mouse = eye(), watched.page.mouse
        mouse.move(150, 300)
        mouse.down()
        mouse.move(250, 340, steps=8)
        mouse.up()
        wait(lambda: eye() != moved, "the user's own place")
        moved = at_rest(watched, eye)
        resize(watched, wait, 1000)
        wait(lambda: client.camera.image_width == 1000, "the size")
        wait(lambda: True)
        assert eye() == moved


def at_rest(watched, what):
    """Return what something is once it stays so while the browser draws further frames."""
    frames = "() => new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
    before, seen = None, what()
    while seen != before:
        for _ in range(5):
            watched.page.evaluate(frames)
            watched.page.wait_for_timeout(100)
        before, seen = seen, what()
    return seen


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_a_button_that_appears_has_a_name_before_the_next_frame(page, recordings):
    with visited(page, recordings) as (watched, wait):
        watched.page.get_by_role("tab", name="Curves").click()
        chart = watched.page.locator(".uplot").first
        wait(chart.is_visible, "a chart")
        chart.hover()
        wait(lambda: watched.page.get_by_role("button", name="enlarge the chart").count() > 0)
        appended = """async () => {
            const button = document.body.appendChild(document.createElement("button"))
            await Promise.resolve()
            return button.getAttribute("aria-label")
        }"""
        assert watched.page.evaluate(appended) == "settings"


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_axe_finds_nothing_serious(page, recordings, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    with visited(page, recordings, width=width, height=844, scheme=scheme) as (watched, wait):
        problems = []
        for tab in ("Curves", "Events", "Scene"):
            watched.page.get_by_role("tab", name=tab).click()
            for _ in range(5):
                wait(lambda: True)
            found = axe.run(watched.page).response["violations"]
            problems += [(tab, one["id"], one["nodes"][0]["html"]) for one in found
                         if one["impact"] in ("serious", "critical")]  # fmt: skip
        assert problems == []


@pytest.mark.slow
@needs_chromium
def test_a_colour_is_seen_as_it_was_meant(page):
    add_light(page.server.scene)
    page.server.scene.add_icosphere("/ball", radius=1.0, color=drawn(RED))
    page.server.initial_camera.position = (1.2, -2.0, 3.2)
    page.server.initial_camera.look_at = (0.0, 0.0, 0.0)
    with opened(page.address, 600, 600) as watched:

        def seen():
            return picture(watched.page).getpixel((300, 330))

        watched.wait(lambda: seen() == pytest.approx(RED, abs=20), f"{RED}, not {seen()}")
