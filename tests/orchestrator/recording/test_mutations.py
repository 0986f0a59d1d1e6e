"""However a recording is damaged, each reader succeeds or says what is wrong in one sentence."""

import contextlib
import json
import random

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from support.messages.recordings import chunks

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.signals import tracking_pieces
from stepbus_orchestrator.diagnosis.conformance.harness import material
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, recover
from stepbus_orchestrator.replay import replay as replay_participant
from stepbus_orchestrator.replay.prepare import prepare, shorten
from stepbus_orchestrator.replay.rerun import read_origin
from stepbus_orchestrator.replay.result import inputs_of
from stepbus_orchestrator.report.device_panels import device_panels
from stepbus_orchestrator.report.summary import Summary
from stepbus_schemas import StepbusError

DESCRIPTIONS = [
    "",
    "null",
    "3",
    "[]",
    '{"limits": null}',
    '{"limits": {"lower": null}}',
    '{"limits": {"lower": ["x"]}}',
    '{"names": 3}',
    '{"names": ["joint1"]}',
    '{"names": ["joint1", "joint1", "joint2"], "details": {"type": []}}',
    '{"like": "nothing"}',
    '{"like": "joint_state"}',
    '{"shape": ["a"]}',
    "{",
    "\ud800".encode("utf-8", "replace").decode(),
]


def read(path, _folder, _original):
    with Recording(path) as recording:
        for port in recording.ports.values():
            list(port.entries())
            _ = port.names, port.t, port.last_step, port.units
        for port in recording.ports.values():
            list(port.messages())


def arrays(path, _folder, _original):
    recording = Recording(path)
    for port in recording.of_type("JointState/1"):
        port.arrays("position", "velocity", "effort")


def report(path, _folder, _original):
    recording = Recording(path)
    summary = Summary()
    for piece in tracking_pieces(recording):
        summary.take(piece)
    summary.lines(tracking_pieces(recording))
    device_panels(recording)


def replay(path, folder, _original):
    recording = Recording(path)
    scenario = prepare(recording, "controller", folder / "source", [], own_program=False)
    short = shorten(scenario, recording, "controller", 4)
    inputs_of(recording, short, "controller", 3)


def conformance(path, folder, original):
    scenario = prepare(Recording(original), "controller", folder / "s", [], own_program=False)
    material.read(scenario, "controller", path)


READERS = {
    "read": read,
    "arrays": arrays,
    "report": report,
    "replay": replay,
    "rerun": lambda path, _folder, _original: read_origin(path),
    "recover": lambda path, folder, _original: recover(path, folder / "fixed.mcap"),
    "diff": lambda path, _folder, original: diff(original, path).text(),
    "diff, the other first": lambda path, _folder, original: diff(path, original).text(),
    "conformance": conformance,
}


def mutated_bytes(chance, path, target):
    """Change, remove, repeat or add a few bytes."""
    data = bytearray(path.read_bytes())
    for _ in range(chance.choice([1, 1, 2, 8])):
        at = chance.randrange(len(data)) if chance.random() < 0.5 else chance.randrange(3000)
        at = min(at, len(data) - 1)
        length = chance.choice([1, 1, 8, 400])
        match chance.randrange(4):
            case 0:
                data[at : at + length] = chance.randbytes(len(data[at : at + length]))
            case 1:
                del data[at : at + length]
            case 2:
                data[at:at] = data[at : at + length]
            case _:
                del data[at:]
        if not data:
            break
    target.write_bytes(data)


def mutated_records(chance, path, target):
    """Write a valid file again, with records that are missing or say something else."""
    rate = chance.choice([0.0, 0.02, 0.3])
    hit = lambda share: chance.random() < share  # noqa: E731
    with path.open("rb") as file, target.open("wb") as out:
        reader = make_reader(file)
        writer = Writer(out, chunk_size=chance.choice([100, 4096, 65536]))
        writer.start(profile="", library=chance.choice(["stepbus", "another"]))
        for item in reader.iter_attachments():
            content = item.data
            if item.name == "scenario.yaml" and hit(0.3):
                content = mutated_text(chance, content)
            if not hit(0.1):
                writer.add_attachment(0, 0, item.name, item.media_type, content)
        for item in reader.iter_metadata():
            if not hit(0.1):
                writer.add_metadata(item.name, {} if hit(0.1) else item.metadata)
        numbers = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in numbers:
                numbers[channel.id] = mutated_channel(chance, writer, schema, channel)
            if hit(rate) or numbers[channel.id] is None:
                continue
            content = chance.randbytes(5) if hit(rate) else message.data
            step = chance.choice([0, 2**32 - 1, 7]) if hit(rate) else message.sequence
            time = chance.choice([0, 2**64 - 1]) if hit(rate) else message.log_time
            writer.add_message(numbers[channel.id], time, content, time, step)
        writer.finish()


def mutated_channel(chance, writer, schema, channel):
    """Register a channel, perhaps another than it was; None to leave it out."""
    if chance.random() < 0.15:
        return None
    name, topic, metadata = schema.name, channel.topic, dict(channel.metadata)
    match chance.randrange(8):
        case 0:
            name = chance.choice(
                ["", "stepbus.", "stepbus.JointState/1", "stepbus.Later/9", "Chain/1"]
            )
        case 1:
            topic = chance.choice(["", "/", "plant", "a/b/c", "plant/joint_state", "stepbus/chain"])
        case 2 | 3:
            metadata["description"] = chance.choice(DESCRIPTIONS)
        case 4:
            metadata = {}
    schema_id = writer.register_schema(name, schema.encoding, schema.data)
    return writer.register_channel(topic, channel.message_encoding, schema_id, metadata)


def mutated_text(chance, content):
    """Change a line of the scenario."""
    lines = content.decode().splitlines()
    at = chance.randrange(len(lines))
    lines[at] = chance.choice(
        ["", "participants: 3", "  - x", "{", lines[-1], json.dumps(lines[at])]
    )
    return "\n".join(lines).encode()


@pytest.mark.parametrize("mutate", [mutated_bytes, mutated_records])
@pytest.mark.parametrize("seed", range(40))
def test_no_reader_ends_in_a_traceback(two_link_recording, tmp_path, mutate, seed):
    broken = tmp_path / "broken.mcap"
    mutate(random.Random(f"{mutate.__name__} {seed}"), two_link_recording, broken)
    for number, reader in enumerate(READERS.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        with contextlib.suppress(StepbusError):
            reader(broken, folder, two_link_recording)


def test_a_recording_damaged_before_its_channels_is_not_replayed(two_link_recording, tmp_path):
    data = two_link_recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: chunks(data)[0][0] + 20])
    with pytest.raises(
        RecordingFailed, match="is damaged before the first step of controller: the chunk"
    ):
        replay_participant(cut, "controller")
