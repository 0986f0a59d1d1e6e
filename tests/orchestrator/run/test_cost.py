"""What a step costs, in calls of functions: the same on every machine, whatever it is doing."""

import cProfile

import stepbus

LIMITS = {"two_link": 280}
"""Calls a step over the orchestrator and all participants, of Python's and of C's functions.

Python 3.11 makes 227, 241 with MuJoCo; 3.12 about 4 % more, a busy machine up to 270. Where more
have come, each step is dearer: see which (`python -m cProfile`) before you raise the limit.
"""


def test_a_step_makes_no_more_calls_than_it_did(tmp_path):
    # The first run of a process imports much.
    _, few, many = (calls_of(tmp_path / str(n), "two_link", n) for n in (10, 200, 600))
    a_step = (many - few) / 400
    assert 0.75 * LIMITS["two_link"] < a_step <= LIMITS["two_link"], f"{a_step:.0f} calls a step"


def calls_of(folder, scenario, steps):
    profile = cProfile.Profile()
    profile.enable()
    try:
        stepbus.run(scenario, set=[f"duration={5 * steps}ms"], out=folder, in_process=True)
    finally:
        profile.disable()
    profile.create_stats()
    return sum(calls for _, calls, *_ in profile.stats.values())
