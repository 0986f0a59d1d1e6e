"""The table of states: complete, walked through by the tests, and as the documentation shows it."""

from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, shelf_a
from support.store_paths import STORE_DOCS

from stepbus_store.mission.checks import CHECKS
from stepbus_store.mission.state_goals import GOALS
from stepbus_store.mission.state_table import LAST, STATES

GOODS = (("cola", 2), ("cola", 3))
PASSAGES = {(state, word, to) for state, row in STATES.items() for word, to in row.then.items()}


_DOWN = [("down", number) for number in range(1, 9)]


_TOGETHER = {"depart", "fold", "ready", "reach", "return", "draw_in", "bring"}


def walked(params=None, **faults):
    return set(sell(FakeStore(shelf_a(*GOODS), **faults), **(params or {})).walked)


def test_every_state_but_the_last_ones_leads_on():
    assert [state for state, row in STATES.items() if not row.then] == list(LAST)


def test_every_state_asks_for_something_or_looks_at_something():
    assert set(GOALS) | set(CHECKS) == set(STATES) - set(LAST)


def test_every_passage_of_the_table_is_walked():
    params = {"attempts": 2, "safe_height": 0.25}
    found = walked({"safe_height": 0.25})
    for state in GOALS:
        if "failed" in STATES[state].then:
            faults = {"noise": 0.006} if state == "shift" else {}
            faults = {"slips": 1} if state in {"release", "back_off"} else faults
            blocked = _DOWN[:6] if state == "narrow" else []
            fails = {**dict.fromkeys(blocked, "blocked"), (state, 1): "invalid"}
            together = {"together": state in _TOGETHER}
            found |= walked(params | together, fails=fails, **faults)
        if "dropped" in STATES[state].then:
            together = {"safe_height": 0.25, "together": state in _TOGETHER}
            found |= walked(together, drops=((state, 1),))
    late = {"verification": "camera", "waits": {"lost": 0.3}}
    found |= walked(late, drift=(0.0, 0.0, 0.0), drops=(("above", 1),))
    found |= walked(fails=dict.fromkeys(_DOWN[:6], "blocked"))
    found |= walked(noise=0.006) | walked(empty_grips=1) | walked(slips=9)
    found |= walked(hidden=("cola_a1_2", "cola_a1_3")) | walked({"opening": 0.05})
    found |= walked({"orders": ["cola"] * 3})
    found |= walked(dark=("order", 0)) | walked(dark=("approach", 1))
    found |= walked(hides={("approach", 1): "cola_a1_2"}) | walked(place_shift=0.1)
    found |= walked(fails={("drive", 1): "jammed"}, drifts=True)
    together = {"together": True}
    found |= walked(together) | walked(together, drops=(("bring", 1),))
    found |= walked(together | {"waits": {"lost": 0.3}}, drops=(("bring", 1),))
    found |= walked({"recover": True}, fails={("drive", 1): "jammed"})
    found |= walked({"recover": True}, fails={("drive", 1): "jammed", ("recover", 1): "no_path"})
    for state in ("drive", "home", *_TOGETHER):
        kept = params | {"together": state in _TOGETHER}
        blocked = {(state, 1): "blocked"}
        found |= walked(kept, fails=blocked)
        for drawn_in in ("fold_again", "withdraw"):
            found |= walked(kept, fails=blocked | {(drawn_in, 1): "invalid"})
    found |= walked(params, fails={("home", 1): "blocked"}, drops=(("withdraw", 1),))
    for state in ("depart", "return"):
        found |= walked(together, fails_late={(state, 1): "blocked"})
    parked = {("park", 1): "no_path"}
    found |= walked(fails=parked) | walked({"recover": True}, fails=parked)
    found |= walked(fails=parked, silent=(("halt", 1),))
    for state in ("depart", "return"):
        found |= walked(together, fails_late={(state, 1): "jammed"})
        found |= walked(together, silent=((state, 1),))
    assert PASSAGES - found == set()
    assert found - PASSAGES == set()


def diagram():
    """Return the table as text, one line per state; ↓ leads to the state in the next line."""
    names = list(STATES)
    below = dict(zip(names, [*names[1:], ""], strict=True))
    return "\n".join(_line(name, STATES[name], below[name]) for name in names)


def _line(name, state, below):
    arrows = [f"{end} {'↓' if to == below else f'→ {to}'}" for end, to in state.then.items()]
    first, others = (arrows or ["■"])[0], arrows[1:]
    return f"{name:<13} {first:<20} {'   '.join(others)}".rstrip()


def test_the_documentation_shows_the_table():
    assert f"```text\n{diagram()}\n```" in (STORE_DOCS / "mission.md").read_text("utf-8")
