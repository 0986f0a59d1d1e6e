"""The judge of the campaign finds each promise that is broken, on cases made by hand."""

import json
import os
import random
import subprocess
import sys
import time

import pytest
from campaign import judge as judging
from campaign.faults import FAULTS, Fault
from campaign.judge import judge
from campaign.log_reader import read
from campaign.mutations import MUTATIONS
from campaign.sandbox import MARK, sandbox
from campaign.test_runs import SCENARIOS, Case, Scenario, cases, has_struck, run_case
from mcap.writer import Writer
from support.tools import needs_store

from stepbus_orchestrator.scenario.load import load

CODES = frozenset({0, 5, 6, 130})
GOOD = {"exit_code": 0, "participant": None, "reason": "finished", "at_step": 61, "steps": 61}


@pytest.fixture
def box(monkeypatch, two_link_recording):
    """Return the sandbox of a run that broke no promise."""
    monkeypatch.setattr(judging, "ORPHAN_GRACE_S", 0.2)
    with sandbox() as made:
        made.out.mkdir()
        (made.out / "run.mcap").write_bytes(two_link_recording.read_bytes())
        made.notes |= {"participants": ("plant", "controller", "mission"), "stepped": True}
        yield made


def end(box, code=0, program="", **fields):
    """Let a process end with a code, and write what it reports."""
    program = program or f"raise SystemExit({code})"
    box.process = subprocess.Popen([sys.executable, "-c", program])
    if fields.get("exit_code", code) is not None:
        result = {**GOOD, "sha256": read(box.out / "run.mcap").sha256, "exit_code": code, **fields}
        (box.out / "result.json").write_text(json.dumps(result))


def broken(box, limit_s=20.0, **fault):
    row = {"codes": CODES, "when": ("middle",), **fault}
    box.faulted_at = time.monotonic()
    return judge(box, Fault(**row), limit_s).broken


@pytest.mark.parametrize(
    ("ending", "codes", "problems"),
    [
        pytest.param({}, CODES, [], id="a run that keeps all promises"),
        pytest.param({}, frozenset({8}), ["false exit code 0, not one of [8]"], id="exit code"),
        pytest.param({"exit_code": 5}, CODES, ["result.json says 5, the exit code is 0"], id="lie"),
        pytest.param({"exit_code": None}, CODES, ["no result.json"], id="no result"),
        pytest.param({"sha256": "0"}, CODES, ["result.json gives another SHA-256"], id="hash"),
        pytest.param({"steps": 100}, CODES, ["finished 100 steps; the log ends at 60"], id="steps"),
    ],
)
def test_what_a_result_says_is_checked(box, ending, codes, problems):
    end(box, **ending)
    found = broken(box, codes=codes)
    assert bool(found) == bool(problems)
    assert all(any(text in line for line in found) for text in problems)


def test_a_hang(box):
    end(box, program="import time; time.sleep(60)")
    assert broken(box, limit_s=0.2)[0].startswith("hang: still running after ")
    box.process.kill()


def test_an_orphan(box):
    end(box)
    orphan = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(60)"],
        env={**os.environ, MARK: box.mark},
    )
    assert [line.split(":")[0] for line in broken(box)] == ["orphan"]
    orphan.kill()
    orphan.wait()


def test_a_file_that_is_left(box):
    end(box)
    (box.temporary / "stepbus-x").mkdir()
    assert broken(box) == ["left behind: stepbus-x"]


@pytest.mark.parametrize(
    "sign", ["Traceback (most recent call last):\n  x", "Exception ignored in: <function>"]
)
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_traceback(box, sign, stream):
    end(box)
    (box.home / stream).write_text(f"all is well\n{sign}\nKeyboardInterrupt\n")
    assert [line.split(":")[0] for line in broken(box)] == ["traceback"]


def test_what_python_itself_prints_is_no_traceback_of_ours(box):
    end(box)
    text = "Error processing line 1 of /x.pth:\nTraceback (most recent call last):\n"
    (box.home / "stderr").write_text(f"{text}  y\nRemainder of file ignored\n")
    assert broken(box) == []


@pytest.mark.parametrize(
    ("code", "ending", "hit", "blames", "text"),
    [
        (5, {"participant": "plant"}, "mission", "hit", "not mission but plant"),
        (5, {}, "mission", "hit", "not mission but None"),
        (5, {"participant": "plant"}, None, None, "no participant was hit, but it says plant"),
        (5, {"participant": "gripper"}, None, "any", "there is no participant gripper"),
        (
            6,
            {"participant": "plant", "at_step": 30},
            "plant",
            "hit",
            "the log has step 60 of plant",
        ),
    ],
)
def test_a_wrong_blame(box, code, ending, hit, blames, text):
    end(box, code, **ending)
    box.notes |= {"hit": hit} if hit else {}
    (line,) = broken(box, **({"blames": blames} if blames else {}))
    assert line.startswith(f"wrong blame: {text}")


def test_what_was_published_on_behalf_of_a_participant_is_not_its_own(tmp_path):
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        fields = {"participant": "mission", "port": "goal"}
        channel = writer.register_channel("mission/goal", "msgpack", 0, fields)
        writer.add_metadata("on_fault", {"participant": "mission", "first": "3", "until": "6"})
        for step in range(6):
            writer.add_message(channel, step, b"", step, step)
        writer.finish()
    log = read(tmp_path / "run.mcap")
    assert (log.last_step_of("mission"), log.last_step) == (2, 5)


def test_a_run_that_finished_has_no_hole(box):
    path = box.out / "run.mcap"
    path.write_bytes(MUTATIONS["message dropped"](random.Random(1), path.read_bytes()))
    end(box)
    assert any(line.startswith("finished with a hole: ") for line in broken(box))


def test_another_recording_than_undisturbed(box):
    end(box)
    box.notes["reference"] = "0"
    assert broken(box)[0].startswith("another recording than")


@pytest.mark.parametrize("mutation", ["message dropped", "message changed"])
def test_a_hole_is_found_by_the_hash_chain(two_link_recording, tmp_path, mutation):
    other = tmp_path / "run.mcap"
    other.write_bytes(MUTATIONS[mutation](random.Random(1), two_link_recording.read_bytes()))
    assert read(two_link_recording).holes() == []
    assert read(other).holes() != []


@pytest.mark.parametrize("reports", [True, False])
def test_a_hole_is_wrong_only_where_it_is_not_reported(box, monkeypatch, reports):
    path = box.out / "run.mcap"
    path.write_bytes(MUTATIONS["message dropped"](random.Random(1), path.read_bytes()))
    end(box, 130)
    if not reports:
        monkeypatch.setattr(judging, "_is_reported", lambda _box: False)
    found = [line for line in broken(box) if "hole" in line]
    assert len(found) == (0 if reports else 1)


@pytest.mark.parametrize("seed", range(5))
def test_a_whole_campaign_has_every_fault_and_every_scenario(seed):
    rows = cases(seed)
    assert sorted(row.fault for row in rows) == sorted(FAULTS)
    assert {row.scenario for row in rows} == set(SCENARIOS)
    assert {row.moment for row in rows} == {"start", "middle", "end"}
    assert rows == cases(seed)
    assert cases(seed, 7) == rows[:7]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=needs_store if name.split("/")[0] in ("store", "baxter") else ())
        for name in SCENARIOS
    ],
)
def test_the_arguments_of_every_scenario_are_valid(name):
    row = SCENARIOS[name]
    words = row.arguments(name, endless=True, patience=2.5)
    scenario = load(words[0], [*words[2::2], f"duration={row.duration}"])
    assert {spec.name for spec in scenario.participants} == set(row.participants)


@pytest.mark.slow
def test_an_undisturbed_run_that_fails_is_an_error_with_its_output(monkeypatch):
    monkeypatch.setitem(SCENARIOS, "two_link", Scenario(duration="7us"))
    case = Case(fault="the logs are removed", scenario="two_link", moment="middle")
    with pytest.raises(RuntimeError, match=r"undisturbed run failed[\s\S]*not a whole number"):
        run_case(case, 1, 2.0)


@pytest.mark.parametrize("name", ["the sockets are removed", "the recording is cut"])
@pytest.mark.parametrize("is_over", [True, False])
def test_a_fault_misses_a_run_that_has_ended(box, name, is_over):
    end(box, program="" if is_over else "import time; time.sleep(60)")
    (box.temporary / "stepbus-x").mkdir()
    if is_over:
        box.process.wait()
    else:
        (box.out / "run.mcap").write_bytes(b"not yet whole")
    assert has_struck(box, FAULTS[name], random.Random(1)) == (not is_over)
    box.process.kill()


def test_a_run_that_ended_before_the_fault_is_judged_as_undisturbed(box):
    end(box)
    box.notes["missed"] = True
    assert broken(box, codes=frozenset({8})) == []
    box.notes["reference"] = "0"
    assert broken(box, codes=frozenset({8}))[0].startswith("another recording than")
