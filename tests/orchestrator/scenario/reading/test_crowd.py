"""More participants than a run can have are refused."""

import pytest
from support.runs.scenario import write

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.load import load

ROW = "  p{}:\n    exec: [python, p.py]\n    outputs: {{out: JointState/1}}\n"
HEAD = "name: crowd\nstep: 5ms\nduration: 50ms\n"


def crowd(count):
    return f"{HEAD}participants:\n{''.join(ROW.format(n) for n in range(count))}"


def refusal(path):
    with pytest.raises(ScenarioError) as caught:
        load(path)
    return str(caught.value)


def test_a_crowd_is_refused_in_one_sentence(tmp_path):
    path = write(tmp_path, crowd(2000), "s.yaml")
    assert "has 2000; a run has at most 1000" in refusal(path)


def test_a_crowd_in_one_line_is_refused_too(tmp_path):
    rows = ", ".join(f"p{n}: {{exec: [p]}}" for n in range(1001))
    path = write(tmp_path, f"{HEAD}participants: {{{rows}}}\n", "s.yaml")
    assert "has 1001; a run has at most 1000" in refusal(path)


def test_what_stands_elsewhere_is_not_counted(tmp_path):
    write(tmp_path, "import stepbus\n", "p.py")
    rows = "".join(f"        k{n}: 1\n" for n in range(1500))
    text = f"{crowd(2)}    params:\n      deep:\n{rows}"
    assert len(load(write(tmp_path, text, "s.yaml")).participants) == 2


@pytest.mark.slow
def test_a_thousand_participants_are_not_too_many(tmp_path):
    write(tmp_path, "import stepbus\n", "p.py")
    assert len(load(write(tmp_path, crowd(1000), "s.yaml")).participants) == 1000
