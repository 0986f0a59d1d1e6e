"""A replayed-log test is three lines, and its failure shows the first divergence."""

import subprocess
import sys

import pytest

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
            "E*first divergence: step 1: controller/command: values[[]0[]]: recording *, replay *",
            "E*input joint_state (plant/joint_state@1): *",
        ]
    )


def test_a_tolerance_file_stands_beside_the_test(logs):
    (logs.path / "slack.yaml").write_text("controller/command: {values: {abs: 10}}")
    text = OTHER_GAIN.replace('kp": 101}', 'kp": 101}, tolerance="slack.yaml"')
    logs.makepyfile(text)
    logs.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=1)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (EQUAL.replace("*.mcap", "*.none"), "*no log matches 'logs/[*].none' in *"),
        (EQUAL.replace(', participant="controller"', ""), "*write @pytest.mark.stepbus_logs(*"),
        ("def test_it(stepbus_replay): pass", "*the fixture stepbus_replay needs the marker*"),
    ],
)
def test_a_marker_that_cannot_work_is_an_error_and_no_silent_pass(logs, text, sentence):
    logs.makepyfile(text)
    result = logs.runpytest_inprocess(*PLUGIN)
    assert result.ret not in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}
    (result.stdout if result.ret == pytest.ExitCode.INTERRUPTED else result.stderr).fnmatch_lines(
        [sentence]
    )


def test_loading_the_plugin_loads_nothing_of_stepbus():
    code = "import stepbus_pytest, sys; print([m for m in sys.modules if m.split('.')[0] in ('stepbus', 'stepbus_pytest', 'stepbus_orchestrator', 'zenoh')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "['stepbus_pytest']"
