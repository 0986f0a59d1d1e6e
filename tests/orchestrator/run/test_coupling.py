"""Delayed, held and absent inputs, and content that is too large for a message."""

import msgspec
import pytest
from mcap.reader import make_reader
from support.runs.joints import write_scenario

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

ECHO = '''
from stepbus import Event, Participant


class Source(Participant):
    """Says its step, as often as it is told to."""

    def update(self, step):
        if step.index % self.config.params.get("speaks", 1):
            return {}
        size = self.config.params.get("size", 0)
        return {"said": Event(level="info", text=f"{step.index}" + "x" * size)}


class Sink(Participant):
    """Says what it has heard."""

    def update(self, step):
        heard = step.get("heard")
        text = "nothing" if heard is None else heard.text
        mark = "!" if step.is_new("heard") else ""
        return {"said": Event(level="info", text=text[:20] + mark)}
'''

SCENARIO = """
name: echo
step: 10ms
duration: 60ms
participants:
  source:
    participant: echo.py:Source
    outputs: {said: Event/1}
  sink:
    participant: echo.py:Sink
    inputs: {heard: {from: source.said, delay: 0}}
    outputs: {said: Event/1}
"""


def hear(folder, *overrides, in_process=True):
    """Return what the sink has heard at each of its steps."""
    path = write_scenario(folder / "source", SCENARIO)
    (folder / "source" / "echo.py").write_text(ECHO)
    result = run(
        load(path, overrides), Options(out=folder / "out", host=host_of(in_process=in_process))
    )
    assert result.exit_code == 0, result.reason
    with result.recording.open("rb") as file:
        rows = make_reader(file).iter_messages(topics=["sink/said"])
        return [msgspec.msgpack.decode(message.data)["text"] for _, _, message in rows]


@pytest.mark.parametrize(
    ("overrides", "heard"),
    [
        ((), "0! 1! 2! 3! 4! 5!"),
        (("sink.inputs.heard.delay=1",), "nothing 0! 1! 2! 3! 4!"),
        (("sink.inputs.heard.delay=3",), "nothing nothing nothing 0! 1! 2!"),
        (("source.every=3",), "0! 0 0 3! 3 3"),
        (("source.every=3", "sink.inputs.heard.delay=1"), "nothing 0! 0 0 3! 3"),
        (("sink.every=2",), "0! 2! 4!"),
        (("sink.every=2", "source.every=3"), "0! 0 3!"),
        (("source.params.speaks=4",), "0! 0 0 0 4! 4"),
    ],
    ids=str,
)
def test_an_input_is_the_newest_output_at_its_due_step_and_is_held(tmp_path, overrides, heard):
    assert " ".join(hear(tmp_path, *overrides)) == heard


def test_bulk_content_arrives_with_its_step(tmp_path):
    bulk = "source.outputs.said={type: Event/1, bulk: true}"
    heard = hear(tmp_path, bulk, "source.params.size=300000", in_process=False)
    assert [text[0] for text in heard] == list("012345")
