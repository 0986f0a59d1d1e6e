"""Cuts, spoils and compares recordings."""

import struct

from mcap.reader import make_reader

MAGIC_BYTES = 8
HEAD = struct.Struct("<BQ")


def messages(path):
    """Return (topic, log time, sequence, content) of all messages in the recorded order."""
    with path.open("rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, m.log_time, m.sequence, m.data) for _, channel, m in found]


def attachments(path):
    """Return name → content."""
    with path.open("rb") as file:
        return {item.name: item.data for item in make_reader(file).iter_attachments()}


def metadata(path):
    """Return name → content."""
    with path.open("rb") as file:
        return {item.name: item.metadata for item in make_reader(file).iter_metadata()}


def record_ends(data):
    """Return where each record of a whole file ends."""
    ends = [MAGIC_BYTES]
    while ends[-1] < len(data) - MAGIC_BYTES:
        _, length = HEAD.unpack_from(data, ends[-1])
        ends.append(ends[-1] + HEAD.size + length)
    return ends


def opcodes(data):
    """Return the kind of each record of a whole file."""
    return [data[end] for end in record_ends(data)[:-1]]
