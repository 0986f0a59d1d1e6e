"""A message of the user's own type that its readers could not take is refused in its source."""

import pytest
from support.runs.scenario import write

import stepbus
from stepbus.testing import Bench, make_config

THRUSTER = {"thrust": {"type": "float[n]", "unit": "N"}, "at": "float[3]"}
TYPES = stepbus.messages.Types({"Thruster/1": THRUSTER})
PROGRAM = """\
from stepbus import Description, Participant

class Source(Participant):
    def describe(self):
        return {"out": Description(names=["left", "right"])}

    def update(self, step):
        return {"out": self.config.types["Thruster/1"](**self.config.params)}

class Like(Source):
    def describe(self):
        return {"out": Description(like="names")}

class Reader(Participant):
    def update(self, step):
        step.get("thruster")
"""
SCENARIO = """\
name: thrusters
step: 5ms
duration: 20ms
types: {Thruster/1: {thrust: {type: "float[n]", unit: N}, at: "float[3]"}}
participants:
  names: {participant: "main.py:Source", params: {thrust: [1.0, 2.0], at: [0.0, 0.0, 0.0]}, outputs: {out: Thruster/1}}
  source: {participant: "main.py:Like", inputs: {names: names.out}, outputs: {out: Thruster/1}, params: %s}
  reader: {participant: "main.py:Reader", inputs: {thruster: source.out}}
"""


@pytest.mark.parametrize(
    ("params", "problem"),
    [
        ("{thrust: [1.0, 2.0], at: [0.0, 0.0, 0.0]}", ""),
        ("{thrust: [1.0, 2.0, 3.0], at: [0.0, 0.0, 0.0]}", "thrust has 3 values for the 2 names (left, right) of the port's description"),
        ("{thrust: [1.0, 2.0], at: [0.0]}", "not a Thruster/1: at: Expected `array` of length 3, got 1"),
        ("{thrust: [1.0, high], at: [0.0, 0.0, 0.0]}", "not a Thruster/1: thrust[1]: Expected `float`, got `str`"),
    ],
)  # fmt: skip
def test_a_message_of_the_wrong_length_is_blamed_on_its_source(tmp_path, params, problem):
    write(tmp_path, PROGRAM, "main.py")
    path = write(tmp_path, SCENARIO % params)
    result = stepbus.run(path, out=tmp_path / "out", in_process=True)
    assert result.participant == ("source" if problem else None)
    if problem:
        assert f"step 0: port 'out': {problem}" in result.reason
        assert "seen by" not in result.reason


def test_a_bench_refuses_it_too():
    class Source(stepbus.Participant):
        def describe(self):
            return {"out": stepbus.Description(names=["left", "right"])}

        def update(self, step):
            return {"out": TYPES["Thruster/1"](thrust=[1.0], at=(0.0, 0.0, 0.0))}

    bench = Bench(Source, make_config(outputs={"out": TYPES["Thruster/1"]}))
    with pytest.raises(stepbus.errors.OutputError, match="thrust has 1 values for the 2 names"):
        bench.step()
