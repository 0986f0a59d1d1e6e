"""Whoever has no token changes nothing in a running scenario, and is counted."""

from __future__ import annotations

from contextlib import closing

import pytest
from support.messages.fuzz import OLD_TOKEN, Mutator, envelopes, outputs
from support.runs.stranger import WAIT_S, disturbed

from stepbus_participant.inputs import carries_token
from stepbus_schemas import HANDSHAKE_STEP, encoding_of

pytestmark = pytest.mark.usefixtures("nothing_is_left")
TO_ORCHESTRATOR = {"join", "ready/controller", "log/controller", "fault/controller"}
LAST_QUERY = 1


def say_those_of_an_old_run(stranger, _token):
    for key, message in envelopes(OLD_TOKEN).items():
        stranger.say_message(key, message)


def say_some_without_a_token(stranger, _token):
    for key in envelopes():
        if key != "join":
            stranger.say(key, b"\x80")
    stranger.ask(b"\x80")


@pytest.mark.parametrize("act", [say_those_of_an_old_run, say_some_without_a_token])
def test_messages_without_the_token_change_nothing_and_are_counted(
    tmp_path, own_temp, reference, act
):
    result = disturbed(tmp_path, own_temp, act)
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    assert result.unauthenticated == len(TO_ORCHESTRATOR) + LAST_QUERY
    # Outputs at the plant; of start, trigger and stop, no session takes any from a participant.
    assert result.drops == {"plant": 1, "controller": 0, "mission": 0}


def test_wildcards_below_a_key_of_ones_own_change_nothing_and_are_counted(tmp_path, own_temp):
    keys = ["bulk/controller/extra/**", "bulk/controller/**"]

    def act(stranger, _token):
        for key in keys:
            stranger.say(key, b"\x80", attachment=bytes(8))

    extra = "controller.outputs.extra={type: Bytes/1, bulk: true}"
    result = disturbed(tmp_path, own_temp, act, extra)
    assert (result.exit_code, result.reason) == (0, "finished")
    assert result.unauthenticated == len(keys) + LAST_QUERY


def test_outputs_ahead_of_their_source_change_nothing(tmp_path, own_temp, reference):
    def act(stranger, _token):
        for step in (HANDSHAKE_STEP, *range(10, 60)):
            for source in ("plant", "controller", "mission"):
                stranger.say_message(f"out/{source}", outputs(step, OLD_TOKEN))

    result = disturbed(tmp_path, own_temp, act)
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    assert result.drops == {"plant": 51, "controller": 102, "mission": 0}


def test_hundreds_of_mutated_messages_over_the_bus_change_nothing(tmp_path, own_temp, reference):
    mutator = Mutator(10)

    def act(stranger, token):
        for key, message in envelopes(token).items():
            for _ in range(50):
                mutant = mutator.broken(message, token)
                while carries_token(mutant, token):
                    mutant = mutator.broken(message, token)
                stranger.ask(mutant) if key == "join" else stranger.say(key, mutant)

    result = disturbed(tmp_path, own_temp, act)
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    assert result.unauthenticated == 50 * len(TO_ORCHESTRATOR) + LAST_QUERY
    assert result.drops == {"plant": 50, "controller": 0, "mission": 0}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("stranger", marks=pytest.mark.slow),
        pytest.param("controller", marks=pytest.mark.slow),
        "orchestrator",
    ],
)
def test_a_strangers_coming_and_going_changes_nothing(tmp_path, own_temp, reference, name):
    def act(stranger, _token):
        with closing(stranger.another_session()) as bus:
            bus.declare_alive(f"alive/{name}")
            next(iter(bus.query("join", b"", encoding_of("Hello/1"), WAIT_S)), None)

    result = disturbed(tmp_path, own_temp, act)
    assert (result.exit_code, result.sha256) == (0, reference.sha256)
    # The orchestrator's session takes no token of another name from the controller's link.
    assert result.unauthenticated == 1 + LAST_QUERY
