"""A slot is used again only when all have taken what it held, however far ahead its source is."""

import itertools
import subprocess
import sys

import pytest
from msgspec import structs
from support.runs.kernel import participant, scenario
from support.surroundings import comes_true

from stepbus_orchestrator.processes import reaper
from stepbus_orchestrator.processes.slots import RunSlots, slot_counts
from stepbus_orchestrator.recording import Sink
from stepbus_orchestrator.run.kernel.barrier import Barrier
from stepbus_orchestrator.scenario.ports import InputSpec, OutputSpec
from stepbus_schemas import Outputs, Ready, due_step

STEPS = 60


def of(window, every, reader):
    """Return a scenario with a source that is as far ahead as it may, and a reader."""
    source = structs.replace(
        participant("source", every=every),
        outputs={"state": OutputSpec(type="JointState/1", bulk=True)},
    )
    return scenario(source, reader, steps=STEPS, window=window)


def fed_back(window, every, reader, publishes, delay):
    """Return the same, where the source reads the reader, and its content is not recorded."""
    run = of(window, every, reader)
    source = structs.replace(
        run.participants[0],
        inputs={"reader": InputSpec(from_="reader.state", delay=delay)},
        publishes=publishes,
        outputs={"state": OutputSpec(type="JointState/1", bulk=True, record="off")},
    )
    return scenario(source, reader, steps=STEPS, window=window)


def may_publish(run, barrier):
    """Return whether a source may publish its next step: it is released, and has its inputs."""
    source, reader = run.participants
    step = barrier.next_step("source")
    read_at = step - (source.every if source.publishes == "first" else 0)
    due = [due_step(read_at, item.delay, reader.every) for item in source.inputs.values()]
    return step < barrier.step_limit and all(one <= barrier.reported["reader"] for one in due)


def fewest_left(run, reader):
    """Return the least number of slots with which the reader always finds what it needs."""
    (source, _), barrier = run.participants, Barrier(run)
    taken, needed = -source.every, 1
    for step in range(0, STEPS, reader.every):
        # The source publishes all it may, before the reader does anything.
        while may_publish(run, barrier):
            barrier.report("source", barrier.next_step("source"))
        if reader.publishes == "first":
            barrier.report("reader", step)
            while may_publish(run, barrier):
                barrier.report("source", barrier.next_step("source"))
        due = due_step(step, reader.inputs["source"].delay, source.every)
        if due > taken:
            oldest = taken + source.every
            needed = max(needed, (barrier.reported["source"] - oldest) // source.every + 1)
            taken = due
        if reader.publishes == "last":
            barrier.report("reader", step)
    return needed


@pytest.mark.parametrize("publishes", ["first", "last"])
def test_there_are_slots_for_all_that_may_not_have_been_taken_yet(publishes):
    for window, every, own, delay in itertools.product(
        (1, 2, 5, 8), (1, 2, 3), (1, 2, 4), range(4)
    ):
        reader = participant("reader", "source", every=own, publishes=publishes, delay=delay)
        run = of(window, every, reader)
        (count,), least = slot_counts(run).values(), fewest_left(run, reader)
        assert least <= count <= least + 1, (window, every, own, delay, publishes)


def test_there_are_fewer_for_readers_that_the_source_waits_for():
    every_one = itertools.product((1, 2, 8), (1, 2, 3), (1, 2, 4), range(4), range(4))
    for window, every, own, delay, back in every_one:
        for first, other in (("first", "last"), ("last", "first"), ("last", "last")):
            if (first, other) == ("last", "last") and not (delay and back):
                continue
            reader = participant("reader", "source", every=own, publishes=other, delay=delay)
            run = fed_back(window, every, reader, first, back)
            (count,), least = slot_counts(run).values(), fewest_left(run, reader)
            ((plain,),) = [slot_counts(run, has_feedback=False).values()]
            which = (window, every, own, delay, back, first, other)
            assert least <= count <= min(plain, least + 1), which


def test_an_output_that_nobody_reads_has_slots_for_the_window():
    assert slot_counts(of(8, 3, participant("reader"))) == {"source.state": 3}


def test_all_that_use_an_output_have_to_have_its_file_open(tmp_path):
    run = of(2, 1, participant("reader", "source"))
    slots = RunSlots(run, str(tmp_path))
    able = Ready(name="", token="", slots=["source.state"])
    assert (tmp_path / "source.state").stat().st_mode & 0o777 == 0o600
    assert slots.agree({"source": able, "reader": able}) == {"source.state": 2}
    assert slots.agree({"source": able, "reader": Ready(name="", token="")}) == {}
    assert slots.agree({"reader": able}) == {}
    outputs = Outputs(token="", step=0, t_ns=0, bulk={"state": 3}, slots={"state": 0})
    assert "no slots were agreed on" in slots.take("source", outputs, Sink({}))
    slots.close()


def test_the_reaper_removes_all_folders_when_the_orchestrator_was_killed(tmp_path):
    folders = [tmp_path / "private", tmp_path / "in memory"]
    for folder in folders:
        folder.mkdir()
        (folder / "camera.image").touch()
    process = subprocess.Popen(
        [sys.executable, reaper.__file__, str(folders[0])], stdin=-1, stdout=-1
    )
    process.stdin.write(f"{folders[1]}\n".encode())
    process.stdin.close()
    assert comes_true(lambda: process.poll() is not None)
    process.stdout.close()
    assert [folder.exists() for folder in folders] == [False, False]
