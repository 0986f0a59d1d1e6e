"""The kit plays bulk ports: right programs pass, and each mistake with them is found."""

import re
import shutil

import pytest
from support.paths import PROGRAMS
from support.runs.conformance import failed, outcomes, program

from stepbus_orchestrator.scenario.load import load
from stepbus_tools.conformance.material import record

SCENARIO = """\
name: bulk
step: 5ms
duration: 60ms
participants:
  camera:
    exec: [python, eye.py, camera]
    outputs:
      frame: {type: Bytes/1, bulk: true}
      number: Scalars/1
  eye:
    exec: [python, eye.py]
    inputs: {frame: camera.frame, number: camera.number}
    outputs:
      copy: {type: Bytes/1, bulk: true}
      first: Scalars/1
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bulk")
    (folder / "scenario.yaml").write_text(SCENARIO)
    shutil.copy(PROGRAMS / "eye.py", folder)
    return record(load(folder), "eye", folder / "run")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "check", "said"),
    [
        ("NoBulkHandshake", "handshake", "no handshake on bulk port copy"),
        ("WrongStamp", "content", "P7.5|no attachment with the token|all that it announces"),
        ("WrongLength", "content", r"copy has 100.* bytes, but "),
        ("AnyRun", "bulk-noise", "reported a fault|differ"),
        ("AnyStep", "bulk-noise", "reported a fault|differ"),
        ("WrongSlot", "slots", "copy: its slot does not hold"),
        ("AnySlot", "slot-stamp", "reported no fault of camera"),
    ],
)
def test_a_mistake_with_bulk_ports_is_found(inputs, tmp_path, mistake, check, said):
    result = outcomes(inputs, program("eye.py", mistake), tmp_path, [check])[check]
    assert result.outcome != "pass", result
    assert re.search(said, result.observed), result.observed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_program_with_bulk_ports_passes_the_kit_in_full(inputs, tmp_path):
    results = outcomes(inputs, program("eye.py"), tmp_path)
    assert failed(results) == [], results
