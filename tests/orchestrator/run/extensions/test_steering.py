"""Calls to a run itself: none of them changes a result."""

from unittest import mock

import pytest
from support.runs.asker import Asker
from support.runs.joints import run_joints

from stepbus_orchestrator.run.extensions import steering
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.live_file import call


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return run_joints(tmp_path_factory.mktemp("steering"), "duration=100ms", in_process=True)


def test_a_run_is_paused_stepped_slowed_and_resumed(tmp_path, plain):
    def ask(method, *args):
        return lambda: call(tmp_path / "out", "", method, args)

    pace = Pace(0)
    asker = Asker(
        pace,
        [
            ask("status"), ask("flush", 0.02), ask("step", 2), ask("speed", 50.0), ask("pause"),
            ask("speed", None), ask("speed", -1), ask("step", 0), ask("dance"), ask("resume"),
        ],
    )  # fmt: skip
    result = run_joints(tmp_path, "duration=100ms", observer=asker, extensions=[pace])
    asker.thread.join()
    status, *done, slow, none, odd, _ = asker.answers
    assert status.value["phase"] == "paused"
    assert status.value["steps"] == 20
    assert all(reply.error is None for reply in done)
    assert "-1 is not a number from 0.001 to 1000" in slow
    assert "0 is not a number of steps" in none
    assert "a run has no call 'dance'" in odd
    assert result.sha256 == plain.sha256


def test_a_run_that_is_asked_to_stop_has_finished(tmp_path):
    pace = Pace(20)
    asker = Asker(pace, [lambda: call(tmp_path / "out", "", "stop")])
    result = run_joints(tmp_path, "duration=1000s", observer=asker, extensions=[pace])
    asker.thread.join()
    assert asker.answers[0].error is None
    assert (result.exit_code, result.reason, result.steps) == (0, "stopped by the user", 20)


def test_who_watches_and_is_killed_does_not_slow_the_run_for_ever():
    now = [0.0]
    asked = steering.Steering(Pace(), mock.Mock(), mock.Mock())
    asked.attach(mock.Mock(**{"clock.monotonic": lambda: now[0]}))
    assert asked.take("flush", [0.02]).error is None
    for now[0] in (9.0, 9.01, 11.0):
        asked.turn()
    assert asked.run.recorder.flush.call_count == 1
