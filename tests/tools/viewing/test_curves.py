"""Curves on the pages of a run and of a recording: what a user picks is drawn."""

import types

import msgspec
import numpy as np
import pytest
from support.browser import Curves, needs_chromium, opened

from stepbus_orchestrator.recording import McapFile, Recorder, Tail
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import Description, Outputs, Types, encode
from stepbus_tools.viewing.live_page import LivePage, Points
from stepbus_tools.viewing.stage.chart_tab import Signal, time_span, value_span

STEP_NS = 20_000_000
OWN = Types({
    "Thruster/1": {"thrust": {"type": "float[n]", "unit": "N"}, "at": {"type": "float[3]"}},
    "Depth/1": {"depth": "float"},
})  # fmt: skip


class Vehicle:
    """A recording of types of a user's own, that grows by a step at a time."""

    def __init__(self, path):
        ports = {"thruster": OutputSpec(type="Thruster/1"), "depth": OutputSpec(type="Depth/1")}
        spec = ParticipantSpec(name="vehicle", exec=("x",), outputs=ports)
        self.recorder = Recorder(McapFile(path), [spec], STEP_NS, types=OWN)
        names = Description(names=["left", "right"])
        described = {"thruster": names, "depth": Description()}
        self.recorder.open_channels({"vehicle": described}, {})
        self.step = 0

    def grow(self):
        step, self.step = self.step, self.step + 1
        thrust = OWN["Thruster/1"](thrust=[10.0 + step, -1.0], at=(0.0, 0.0, 0.1))
        depth = OWN["Depth/1"](depth=-0.5 * step)
        ports = {"thruster": msgspec.Raw(encode(thrust)), "depth": msgspec.Raw(encode(depth))}
        outputs = Outputs(token="", step=step, t_ns=step * STEP_NS, ports=ports)
        self.recorder.offer("vehicle", outputs)
        self.recorder.write_below(step + 1)
        self.recorder.flush()


@pytest.fixture
def vehicle(tmp_path):
    vehicle = Vehicle(tmp_path / "run.mcap")
    yield vehicle
    vehicle.recorder.finish(vehicle.step - 1, ["vehicle"])


@pytest.fixture
def tail(vehicle, tmp_path):
    vehicle.grow()
    tail = Tail(tmp_path / "run.mcap")
    tail.poll()
    yield tail
    tail.close()


def test_limits_of_a_curve_before_now_change_seldom():
    spans = [time_span(np.array([-length, 0.0])) for length in (0.02, 0.021, 1.5, 7.0, 29.9, 31.0)]
    assert [-low for low, _ in spans] == pytest.approx([0.02, 0.03, 2.0, 8.0, 30.0, 40.0])
    assert time_span(np.array([0.5, 9.0])) == (0.5, 9.0)


def test_a_chart_has_room_for_its_values_and_for_limits_that_are_near():
    values = np.array([[0.0, 1.0], [0.5, np.nan]])
    assert value_span(values) == pytest.approx((-0.15, 1.2), abs=0.11)
    low, high = value_span(values, [(-0.2, 1.2), (-9.0, np.inf)])
    assert (-0.6 < low < -0.2, 1.2 < high < 1.8) == (True, True)
    assert value_span(np.full((3, 1), np.nan))[0] < 0 < value_span(np.zeros((2, 1)))[1]


def test_what_was_there_before_a_port_was_picked_is_drawn(vehicle, tail):
    points = Points(tail, ["vehicle/depth"])
    for _ in range(4):
        points.add()
        vehicle.grow()
        tail.poll()
    times, values = points.sample(Signal(topic="vehicle/depth", field="depth", names=("0",)))
    assert times == pytest.approx([-0.06, -0.04, -0.02, 0.0])
    assert values[:, 0].tolist() == [0.0, -0.5, -1.0, -1.5]


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(600)
def test_the_ports_of_a_users_own_types_have_curves(vehicle, tail, page):
    client = types.SimpleNamespace(status={}, offered={}, last="")
    live = LivePage(page.server, tail, client)

    def grown(is_done):
        vehicle.grow()
        live.turn(tail.poll())
        return is_done()

    with opened(page.address, 800, 500) as watched:
        curves = Curves(watched)
        watched.wait(lambda: grown(watched.page.get_by_role("tab").count), "the page")
        watched.page.get_by_role("tab", name="Curves").press("Enter")
        watched.wait(lambda: grown(lambda: curves.has("x", "y", "z")), "the position")
        curves.pick("at", "thrust [N]")
        watched.wait(lambda: grown(lambda: curves.has("left", "right")), "the thrust")
        colours = {"6,104,187", "232,72,12"}
        watched.wait(lambda: colours <= curves.colours(), "their colours")
        drawn = curves.drawn()
        left, right = (np.array(row) for row in drawn.data[1:3])
        assert np.all(np.diff(left) >= 1.0)
        assert set(right) == {-1.0}
        assert drawn.x[0] <= drawn.data[0][0] < drawn.data[0][-1] == drawn.x[1]
        assert not watched.errors
