"""The layout of a recording (P13): every topic, attachment and metadata name, spelled only here."""

import re
from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from stepbus_schemas import CHAIN_EVERY

RUN_FILE = "run.mcap"
TIMING_FILE = "timing.mcap"
CHECKPOINTS_FOLDER = "checkpoints"
"""Beside the recording, and no part of it: states of participants, and an index of them."""
CHECKPOINTS_INDEX = "index.json"

PROFILE = ""
LIBRARY = "stepbus 3"
"""From version 2 on, the data section has a checksum: no byte of it changes unseen. From version 3
on, a chunk ends with a whole step: whatever ends a file between two chunks cuts no step in two."""
FIRST = "stepbus"
LIBRARIES = frozenset({FIRST, "stepbus 2", LIBRARY})
"""Chunks, attachments and the summary of these have checksums: none is a sign of damage."""
_NUMBERED = re.compile(r"stepbus ([2-9]|[1-9][0-9]+)")
_STEP = re.compile(r"[0-9]{1,18}")
CHUNK_BYTES = 64 * 1024
MESSAGE_ENCODING = "msgpack"
SCHEMA_ENCODING = "jsonschema"

CHAIN_TOPIC = "stepbus/chain"
CHAIN_TYPE = "Chain/1"
CALLS_TOPIC = "stepbus/calls"
CALLS_TYPE = "CallRecord/1"

SCENARIO_ATTACHMENT = "scenario.yaml"
FAULTS_METADATA = "faults"
FALLBACK_METADATA = "on_fault"
BRANCH_METADATA = "branch"
"""Participant → the step from which its outputs are its own, where it was changed by a branch."""
INCOMPLETE_METADATA = "incomplete"
"""Participant → the first step whose outputs are not all recorded, where the run failed."""
DESCRIPTION_KEY = "description"
"""Metadata of a channel: its `Description` as JSON."""
RECORD_KEY = "record"
"""Metadata of a channel that is not recorded whole: `every 10`, or `off`."""

_SCHEMA_PREFIX = "stepbus."
_FILES = "files/"
_VERSIONS = "versions/"

ORCHESTRATOR = "orchestrator"
ENVIRONMENT_METADATA = _VERSIONS + ORCHESTRATOR
"""What the orchestrator runs on; that of a participant is under its name."""


Source = str | PathLike[str]
"""A recording: its path, the folder of its run, or the `Result` of the run."""


def recording_file(source: Source) -> Path:
    """Return the recording that a path means: itself, or run.mcap in the folder of a run."""
    path = Path(source)
    return path / RUN_FILE if path.is_dir() else path


def is_newer(library: str) -> bool:
    """Return whether a file has a layout that a later version of stepbus has introduced."""
    return library not in LIBRARIES and _NUMBERED.fullmatch(library) is not None


def is_step(text: str) -> bool:
    """Return whether a text of a metadata record is a step."""
    return _STEP.fullmatch(text) is not None


def topic_of(participant: str, port: str) -> str:
    """Return the topic of a port: `<participant>/<port>`."""
    return f"{participant}/{port}"


def split_topic(topic: str) -> tuple[str, str]:
    """Return participant and port of a topic."""
    participant, _, port = topic.partition("/")
    return participant, port


def schema_name(type_name: str) -> str:
    """Return the schema name of a message type: `stepbus.JointState/1`."""
    return _SCHEMA_PREFIX + type_name


def type_of_schema(name: str) -> str:
    """Return the message type of a schema name."""
    return name.removeprefix(_SCHEMA_PREFIX)


def file_attachment(name: str) -> str:
    """Return the attachment name of a file that the scenario names."""
    return _FILES + name


def files_of(attachments: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files of a scenario among attachments: name → content."""
    return {
        name.removeprefix(_FILES): content
        for name, content in attachments.items()
        if name.startswith(_FILES)
    }


def versions_metadata(participant: str) -> str:
    """Return the name of the metadata that lists what a participant runs on."""
    return _VERSIONS + participant


def versions_of(metadata: Mapping[str, Mapping[str, str]]) -> dict[str, Mapping[str, str]]:
    """Return what the participants, and the orchestrator, ran on: name → library → version."""
    return {
        name.removeprefix(_VERSIONS): versions
        for name, versions in metadata.items()
        if name.startswith(_VERSIONS)
    }


def channel_metadata(
    participant: str, port: str, description: str, record: str = ""
) -> dict[str, str]:
    """Return the metadata of a port's channel. description: as JSON. record: if it is not whole."""
    whole = {"participant": participant, "port": port, DESCRIPTION_KEY: description}
    return {**whole, RECORD_KEY: record} if record else whole


def incomplete(step: int) -> str:
    """Return the note on the last step of a recording that was ended within it."""
    return f"step {step}, the last one, is incomplete and was skipped"


def has_chain(step: int) -> bool:
    """Return whether the hash chains are recorded after this step (P13.3)."""
    return (step + 1) % CHAIN_EVERY == 0
