"""Runs on several hosts, struck by what is drawn: each ends in time, with the right name, everywhere.

`DISTANT_RUNS=200` draws so many.
"""

import contextlib
import os
import random
import signal
import time

import psutil
import pytest
from support.runs.distant import ENDLESS, LEASE_S, NAMES, SHORT, Distant

from stepbus_orchestrator.errors import ExitCode

pytestmark = [
    pytest.mark.usefixtures("nothing_is_left"),
    pytest.mark.slow,
    pytest.mark.timeout(300),
]
RUNS = int(os.environ.get("DISTANT_RUNS", "20"))
STRIKES = ("cut", "kill", "freeze", "orchestrator")
MOMENTS = ("start", "middle", "end")
CODES = {
    "cut": {ExitCode.DIED, ExitCode.STEP_TIMEOUT},
    "kill": {ExitCode.DIED},
    "freeze": {ExitCode.STEP_TIMEOUT},
}
MORE_CODES = {
    "start": {ExitCode.START},
    "middle": set(),
    "end": {ExitCode.FINISHED, ExitCode.STOP_TIMEOUT},
}
MOST_BYTES = {"middle": 150_000, "end": 48_000}
JOIN_S = 40.0
DEADLINES_S = {"start": JOIN_S + 10 + 10 + 3, "middle": 3.0, "end": 3.0 + 3.0}
MARGIN_S = 2.0


def wait_for(moment, distant, chance):
    """Wait until the moment has come, somewhere within it."""
    if moment != "start":
        distant.under_way(chance.randrange(8_000, MOST_BYTES[moment]), may_end=moment == "end")
    time.sleep(chance.uniform(0, 8 if moment == "start" else 1))


def strike(what, distant, who):
    match what:
        case "cut":
            distant.wan.cut(distant.hosts[who])
        case "kill":
            distant.kill(who)
        case "freeze":
            distant.kill(who, signal.SIGSTOP)
        case "orchestrator":
            # It may just have ended.
            with contextlib.suppress(psutil.NoSuchProcess):
                distant.orchestrator.kill()


@pytest.mark.parametrize("seed", range(RUNS))
def test_a_run_that_is_struck_ends_everywhere_with_the_right_name(tmp_path, wan, seed):
    chance = random.Random(seed)
    what, moment, who = map(chance.choice, (STRIKES, MOMENTS, NAMES))
    network = wan(4, seed)
    network.shape(delay_s=chance.choice((0, 0, 0.002)))
    settings = [*(SHORT if moment == "end" else ENDLESS)]
    settings += [f"{name}.ready_timeout=10s" for name in NAMES]
    distant = Distant(tmp_path, network, *settings, more=("--join-timeout", f"{JOIN_S:g}s")).join()
    wait_for(moment, distant, chance)
    had_ended, since = distant.has_ended(), time.monotonic()
    strike(what, distant, who)
    limit_s = DEADLINES_S[moment] + LEASE_S + MARGIN_S
    drawn = f"{what} {who} at {moment}"
    if what == "orchestrator" or had_ended:
        distant.within(LEASE_S + MARGIN_S, since=since)
        return
    result = distant.result()
    assert time.monotonic() - since < limit_s, drawn
    assert result["exit_code"] in CODES[what] | MORE_CODES[moment], (drawn, distant.said())
    assert result["exit_code"] == 0 or result["participant"] == who, (drawn, distant.said())
    if what == "freeze":
        distant.kill(who, signal.SIGCONT)
        since = time.monotonic()
    distant.within(limit_s, since=since)
