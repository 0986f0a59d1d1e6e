"""Sweeps from Python: what they are called with."""

import pytest

import stepbus
from stepbus import sweeps


@pytest.fixture
def asked(monkeypatch):
    """Return which sweeps would run, and how."""
    calls = []
    monkeypatch.setattr(
        sweeps, "run_sweep", lambda plan, options, *_: calls.append((plan.spec, options))
    )
    return calls


@pytest.mark.slow
def test_axes_are_texts_or_a_map_of_values(asked):
    by_map = {
        "controller.params.kp": [50, 100.5],
        "controller.params.law": ["pd", "pd_gravity"],
        "controller.params.kd": "10:20:3",
        "mission.params.omega": "~uniform(0, 1)",
        "seed": range(3),
    }
    stepbus.sweep("two_link", by_map, samples=4, retry=2, timeout_s=9.0, jobs=1, keep="all")
    texts = [
        "controller.params.kp=50,100.5",
        'controller.params.law="pd","pd_gravity"',
        "controller.params.kd=10:20:3",
        "mission.params.omega~uniform(0, 1)",
        "seed=0,1,2",
    ]
    stepbus.sweep("two_link", texts, samples=4)
    (spec, options), (same, plain) = asked
    assert list(spec.vary) == texts
    assert spec == same
    assert (options.retries, options.timeout_s, options.jobs, options.keep) == (2, 9.0, 1, "all")
    assert options.home == plain.home
    assert options.home.parts[0] == "sweeps"


def test_a_file_of_a_sweep_is_replaced_in_parts(asked, tmp_path):
    file = tmp_path / "sweep.yaml"
    file.write_text("scenario: two_link\nvary: ['duration=1s,2s']\nrepeats: 3\nseed: 5\n")
    stepbus.sweep(file, set={"batch": 2}, seed=0)
    spec = asked[0][0]
    assert spec.seed == 0
    assert (list(spec.vary), spec.repeats, list(spec.set)) == (["duration=1s,2s"], 3, ["batch=2"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"vary": ()}, "needs at least one axis"),
        ({"vary": ["seed=1:5"]}, "a range needs a count"),
        ({"vary": ["seed=1,2"], "optimize": "rmse"}, "an optimizer needs a number of runs"),
        ({"vary": ["seed=1,2"], "sampling": "sobool"}, "sobool"),
        ({"vary": ["seed=1,2"], "repeats": -1}, "repeats"),
    ],
)
def test_what_is_no_sweep_is_one_sentence(asked, arguments, sentence):
    with pytest.raises(stepbus.StepbusError) as caught:
        stepbus.sweep("two_link", **arguments)
    assert sentence in str(caught.value)
    assert not asked
