"""Numbers of runs from Python: metrics, tables, and how far two runs are apart."""

import math
import sys

import numpy as np
import pytest
from support.messages.recordings import write

import stepbus
from stepbus_schemas import JointState, Scalars

JOINT = "plant.joint_state.position.joint1"


def run(tmp_path_factory, name, **values):
    out = tmp_path_factory.mktemp("comparisons") / name
    return stepbus.run("two_link", set={"duration": "1s", **values}, out=out, in_process=True)


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    return run(tmp_path_factory, "usual")


@pytest.fixture(scope="module")
def softer(tmp_path_factory):
    return run(tmp_path_factory, "softer", **{"controller.params.kp": 30})


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    return run(tmp_path_factory, "coarse", step="10ms")


def test_a_run_has_the_metrics_of_a_sweep_with_their_units(usual):
    metrics = usual.metrics
    position = stepbus.Recording(usual)["plant.joint_state"].position[:-1]
    reference = stepbus.Recording(usual)["mission.reference"].position[: len(position)]
    expected = np.sqrt(np.mean((reference - position) ** 2, axis=0))
    assert [metrics["rmse.joint1"], metrics["rmse.joint2"]] == pytest.approx(expected.tolist())
    assert metrics.units == {"duration": "s", "energy": "J", "rmse": "rad", "rmse.joint1": "rad", "rmse.joint2": "rad"}  # fmt: skip
    assert (metrics["success"], metrics["duration"]) == (1, 1.0)
    assert repr(metrics).startswith("<Metrics success 1, duration 1 s, rmse")
    assert "\n" not in repr(metrics)


def test_a_run_compared_with_itself_is_not_apart(usual):
    compared = stepbus.compare(usual, usual.folder)
    assert {error.max for error in compared.errors} == {0.0}
    assert compared.worst is None
    assert compared.span_s == (0.0, 1.0)
    assert repr(compared).endswith(f"0 of {len(compared.errors)} numbers differ>")


def test_two_runs_are_as_far_apart_as_their_arrays(usual, softer):
    compared = stepbus.compare(usual, softer)
    one, other = (stepbus.Recording(r)["plant.joint_state"].position[:, 0] for r in (usual, softer))
    apart = other - one
    error = compared[JOINT]
    assert error.rmse == pytest.approx(np.sqrt(np.mean(apart**2)))
    assert error.share == pytest.approx(error.rmse / np.sqrt(np.mean(one**2)))
    assert (error.mean, error.max) == pytest.approx((np.mean(apart), np.max(np.abs(apart))))
    assert error.at_s == pytest.approx(0.005 * np.argmax(np.abs(apart)))
    assert (error.unit, error.count) == ("rad", 201)
    assert "numbers differ, most " in repr(compared)
    assert "\n" not in repr(compared)


def test_runs_with_different_steps_are_aligned_by_time(usual, coarse):
    one, other = (stepbus.Recording(r)["plant.joint_state"].position[:, 0] for r in (usual, coarse))
    expected = np.sqrt(np.mean((other - one[::2]) ** 2))
    for pair in ((usual, coarse), (coarse, usual)):
        assert stepbus.compare(*pair)[JOINT].rmse == pytest.approx(expected)
        assert stepbus.compare(*pair)[JOINT].count == 101


def test_a_comparison_is_a_table_and_says_what_it_does_not_have(usual, softer, tmp_path):
    compared = stepbus.compare(usual, softer)
    frame = compared.frame()
    assert frame.loc[("plant.joint_state", "position.joint1"), "rmse"] == compared[JOINT].rmse
    with pytest.raises(stepbus.WiringError, match=r"position\.joint2"):
        compared["plant.joint_state.position.joint"]
    with pytest.raises(stepbus.errors.RecordingFailed):
        stepbus.compare(usual, tmp_path / "none.mcap")


def test_signals_are_columns_of_a_frame_over_time(usual):
    recording = stepbus.Recording(usual)
    frame = recording.frame("plant.joint_state.position", "mission.reference")
    assert {name.rpartition(".")[0] for name in frame if name.startswith("plant")} == {
        "plant.joint_state.position"
    }
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame[JOINT], recording["plant.joint_state"].position[:, 0])
    assert frame.attrs["units"][JOINT] == "rad"
    # The reference has no closing sample.
    assert np.isnan(frame["mission.reference.position.joint1"].iloc[-1])
    assert {name.rsplit(".", 1)[0] for name in recording.frame("plant/joint_state")} >= {"plant.joint_state.velocity"}  # fmt: skip
    assert JOINT in recording.frame()


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ("plan.joint_state", "no port 'plan.joint_state'"),
        ("plant.joint_state.positon", "has no values 'positon'; did you mean"),
        ("plant", "has no port 'plant'"),
    ],
)
def test_a_frame_of_a_signal_that_is_not_there_is_one_sentence(usual, signal, words):
    with pytest.raises(stepbus.WiringError, match=words):
        stepbus.Recording(usual).frame(signal)


def test_without_pandas_a_frame_says_how_to_install_it(usual, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(stepbus.errors.ExtraMissing, match=r"a DataFrame needs pandas.*\[export\]"):
        stepbus.Recording(usual).frame()
    with pytest.raises(stepbus.errors.ExtraMissing, match="needs pandas"):
        stepbus.compare(usual, usual).frame()


def scalars(path, values):
    messages = [Scalars(values=[value]) for value in values]
    return write(path, state=("Scalars/1", ["x"], messages))


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf])
def test_a_number_differs_infinitely_from_nan_and_from_infinities(tmp_path, odd):
    numbers = [0.5] * 20
    usual = scalars(tmp_path / "usual.mcap", numbers)
    spoiled = scalars(tmp_path / "spoiled.mcap", [*numbers[:7], odd, *numbers[8:]])
    for pair in ((usual, spoiled), (spoiled, usual)):
        compared = stepbus.compare(*pair)
        error = compared["plant.state.values.x"]
        assert compared.worst == error
        assert (error.count, error.rmse, error.share, error.max) == (20, *[math.inf] * 3)
        assert error.at_s == pytest.approx(0.07)
    assert stepbus.compare(spoiled, spoiled).worst is None


def test_a_value_that_a_message_lacks_is_not_compared(tmp_path):
    for name, efforts in {"some": [None, [2.0], [3.0]], "all": [[1.0], [2.0], [5.0]]}.items():
        rows = [JointState(position=[0.0], effort=effort) for effort in efforts]
        write(tmp_path / f"{name}.mcap", state=("JointState/1", ["x"], rows))
    error = stepbus.compare(tmp_path / "all.mcap", tmp_path / "some.mcap")["plant.state.effort.x"]
    assert (error.count, error.max) == (2, 2.0)
    assert error.rmse == pytest.approx(math.sqrt(2))
