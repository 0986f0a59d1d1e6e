"""What an undisturbed run records: read by the library of MCAP."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from stepbus_orchestrator.recording import layout

from .execution import Execution
from .programs import STEP_NS
from .tape import Tape

FOLDER = "/dev/shm"


class Row(NamedTuple):
    """A recorded message."""

    topic: str
    step: int
    content: bytes


def rows_of(path: Path) -> list[Row]:
    """Return the messages of a recording in their order, read by the library of MCAP."""
    topics: dict[int, str] = {}
    rows = []
    with path.open("rb") as file:
        for record in StreamReader(file, record_size_limit=None).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                if record.channel_id not in topics:
                    raise ValueError(
                        f"a message of channel {record.channel_id}, which is not there"
                    )
                if record.log_time != STEP_NS * record.sequence:
                    raise ValueError(f"a message of step {record.sequence} is of another time")
                rows.append(Row(topics[record.channel_id], record.sequence, record.data))
    return rows


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    """Return the metadata of a recording, read by the library of MCAP."""
    with path.open("rb") as file:
        records = StreamReader(file, record_size_limit=None).records
        return {item.name: item.metadata for item in records if isinstance(item, Metadata)}


class Reference(NamedTuple):
    """An undisturbed run. rows: what it has recorded. places: topic → its rank within a step."""

    rows: Sequence[Row]
    by_topic: Mapping[str, Sequence[Row]]
    places: Mapping[str, int]


@cache
def reference(name: str, steps: int) -> Reference:
    """Return the undisturbed run of a scenario."""
    with TemporaryDirectory(dir=FOLDER) as folder:
        execution = Execution(Tape(name, steps), Path(folder) / "run")
        execution.run()
        result = execution.result
        assert result is not None, execution.crash
        assert result.exit_code == 0, result.reason
        rows = rows_of(Path(folder) / "run" / "run.mcap")
    by_topic: dict[str, list[Row]] = {}
    for row in rows:
        by_topic.setdefault(row.topic, []).append(row)
    # A call precedes the outputs of its step.
    topics = sorted(by_topic, key=layout.CALLS_TOPIC.__ne__)
    places = {topic: place for place, topic in enumerate(topics)}
    return Reference(rows, by_topic, places)
