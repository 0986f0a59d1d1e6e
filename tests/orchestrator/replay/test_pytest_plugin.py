"""A replayed-log test is three lines, and its failure shows the first divergence."""

import subprocess
import sys

# pytester forgets the modules that a test has imported, and NumPy is loaded once in a process.
import numpy as np  # noqa: F401
import pytest

from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

pytest_plugins = ["pytester"]

PLUGIN = ("-p", "no:cacheprovider")

EQUAL = """
    import pytest

    @pytest.mark.stepbus_logs("logs/*.mcap", participant="controller")
    def test_controller(stepbus_replay):
        stepbus_replay()
"""

OTHER_GAIN = """
    import pytest

    @pytest.mark.stepbus_logs("logs/a.mcap", participant="controller")
    def test_controller(stepbus_replay):
        stepbus_replay(set={"controller.params.kp": 101})
"""


@pytest.fixture
def logs(pytester, two_link_recording):
    """Make a folder with two logs."""
    folder = pytester.mkdir("logs")
    for name in ("a", "b"):
        (folder / f"{name}.mcap").write_bytes(two_link_recording.read_bytes())
    return pytester


@pytest.mark.slow
def test_a_test_runs_once_for_each_log(logs):
    logs.makepyfile(EQUAL)
    result = logs.runpytest_inprocess("-v", *PLUGIN)
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*test_controller[[]logs/a.mcap[]] PASSED*", "*logs/b.mcap*"])


def test_a_failure_shows_the_first_divergence_with_its_inputs(logs):
    logs.makepyfile(OTHER_GAIN)
    result = logs.runpytest_inprocess(*PLUGIN)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "E*AssertionError: *a.mcap: controller differs from the recording",
            "E*first divergence: step 1: controller/command: values[[]joint1[]]: recording *, replay *",
            "E*input joint_state (plant/joint_state@1): *",
        ]
    )


def test_a_tolerance_file_stands_beside_the_test(logs):
    (logs.path / "slack.yaml").write_text("controller/command: {values: {abs: 10}}")
    text = OTHER_GAIN.replace('kp": 101}', 'kp": 101}, tolerance="slack.yaml"')
    logs.makepyfile(text)
    logs.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=1)


FINE = """
    def test_of_something_else(): pass
"""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (EQUAL.replace("*.mcap", "*.none"), "no log matches 'logs/[*].none' in *"),
        (EQUAL.replace(', participant="controller"', ""), "write @pytest.mark.stepbus_logs(*"),
        ("\n    def test_it(stepbus_replay): pass", "the fixture stepbus_replay needs the marker*"),
    ],
)
def test_a_marker_that_cannot_work_fails_its_test_and_no_other(logs, text, sentence):
    logs.makepyfile(text + FINE)
    result = logs.runpytest_inprocess(*PLUGIN)
    result.assert_outcomes(errors=1, passed=1)
    result.stdout.fnmatch_lines([sentence])


def test_a_log_may_be_the_folder_of_its_run(logs, two_link_recording):
    (logs.path / "runs" / "one").mkdir(parents=True)
    (logs.path / "runs/one/run.mcap").write_bytes(two_link_recording.read_bytes())
    logs.makepyfile(EQUAL.replace("logs/*.mcap", "runs/*"))
    logs.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=1)


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
def test_a_test_catches_a_gain_changed_in_the_work_tree(pytester):
    write_starter(pytester.path / "arm", "python")
    scenario = load(pytester.path / "arm", ["duration=50ms"])
    run(scenario, Options(out=pytester.path / "out", host=InProcess()))
    (pytester.mkdir("logs") / "a.mcap").write_bytes((pytester.path / "out/run.mcap").read_bytes())
    pytester.makepyfile(EQUAL.replace("stepbus_replay()", 'stepbus_replay(source="arm")'))
    pytester.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=1)
    file = pytester.path / "arm/scenario.yaml"
    file.write_text(file.read_text().replace("kp: 200", "kp: 999"))
    result = pytester.runpytest_inprocess(*PLUGIN)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E*controller.params.kp is 999, recorded 200 (scenario.yaml:17)"])
    pytester.makepyfile(EQUAL.replace("stepbus_replay()", "stepbus_replay(recorded=True)"))
    pytester.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=1)


def test_loading_the_plugin_loads_nothing_of_stepbus():
    code = "import stepbus_pytest, sys; print([m for m in sys.modules if m.split('.')[0] in ('stepbus', 'stepbus_pytest', 'stepbus_orchestrator', 'zenoh')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "['stepbus_pytest']"
