"""Messages name arguments as the command line does, from Python too."""

import subprocess
import sys

import pytest

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode

SHORT = {"duration": "50ms"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"set": {"controller.params.kpp": 3}}, "--set controller.params.kpp=3: "),
        ({"faults": ["kil plant at 3"]}, "--fault kil plant at 3: "),
        ({"faults": ["kill plant at 3"], "in_process": True}, "omit --in-process"),
        ({"set": {"plant.start": "external"}, "in_process": True}, "omit --in-process"),
    ],
)
def test_an_error_names_the_argument(tmp_path, arguments, words):
    with pytest.raises(stepbus.WiringError) as caught:
        stepbus.run("two_link", out=tmp_path / "out", **arguments)
    assert words in str(caught.value)


def test_a_folder_that_holds_a_run_is_an_error_of_its_own(tmp_path, capsys):
    out = tmp_path / "out"
    assert stepbus.run("two_link", set=SHORT, out=out, in_process=True).exit_code == 0
    with pytest.raises(stepbus.errors.OutputExists, match="choose another --out") as caught:
        stepbus.run("two_link", set=SHORT, out=out, in_process=True)
    assert isinstance(caught.value, FileExistsError)
    assert not isinstance(caught.value, stepbus.errors.RecordingFailed)
    assert main(["run", "two_link", "--out", str(out)]) == ExitCode.SCENARIO
    assert "choose another --out" in capsys.readouterr().err


def test_a_run_in_this_process_leaves_stdout_to_its_program(tmp_path):
    code = "import stepbus, sys; r = stepbus.run('two_link', set={'duration': '50ms'}, out=sys.argv[1], in_process=True); print(r.outcome)"  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "out")], check=True, capture_output=True, text=True
    )  # fmt: skip
    assert done.stdout == "finished\n"
