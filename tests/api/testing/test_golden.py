import pytest

from stepbus import testing


def test_an_equal_replay_returns_its_result_and_a_tolerance_may_be_a_number(two_link_recording):
    assert testing.assert_replays(two_link_recording.parent, "controller").steps == 60
    override = {"controller.params.kp": 101}
    with pytest.raises(AssertionError, match=r"differs from the recording\nfir"):
        testing.assert_replays(two_link_recording, "controller", set=override)
    for tolerance in (10.0, {"command.values": 10, "status.error": 10}):
        testing.assert_replays(two_link_recording, "controller", set=override, tolerance=tolerance)


def test_what_cannot_be_replayed_is_an_assertion_error(two_link_recording):
    with pytest.raises(AssertionError, match=r"run\.mcap: .*'controlle'"):
        testing.assert_replays(two_link_recording, "controlle")
