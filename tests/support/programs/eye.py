"""Reads a bulk port and publishes another one; with a word, it makes a mistake in that."""

import os
import sys

import stepbus
from stepbus_participant.bus import slots
from stepbus_participant.session import outbox

MISTAKE = sys.argv[1] if len(sys.argv) > 1 else ""


class Camera(stepbus.Participant):
    """Publishes 100 kB at every other step, and the step's number at each."""

    def update(self, step):
        frame = stepbus.messages.BytesMessage(data=bytes([step.index % 251]) * 100_000)
        number = {"number": stepbus.messages.Scalars(values=[float(step.index)])}
        return {**number, "frame": frame} if step.index % 2 == 0 else number


class Eye(stepbus.Participant):
    """Publishes a frame upside down, as bulk too, and what its first byte and the number are."""

    def update(self, step):
        frame, number = step.get("frame"), step.get("number")
        first = frame.data[0] if frame is not None else -1.0
        found = {
            "first": stepbus.messages.Scalars(values=[first, number.values[0] if number else -1.0])
        }
        if frame is not None and step.is_new("frame"):
            found["copy"] = stepbus.messages.BytesMessage(data=frame.data[::-1] + b"end")
        return found


def _any_stamp(attachment, token):
    return int.from_bytes(attachment[:8], "little", signed=True)


def _any_step(attachment, token):
    step = _read_stamp(attachment, token)
    return _Any(step) if step is not None else None


def _any_slot(content, decode):
    offset, _, length = content._where  # noqa: SLF001
    return decode(os.pread(content._file.fd, length, offset + 16))  # noqa: SLF001


class _Any(int):
    def __eq__(self, other):
        return other != -1 and int(self) != -1

    __hash__ = int.__hash__


if MISTAKE == "NoBulkHandshake":
    outbox.Outbox.send_handshake = lambda self: self._put(self._pack(-1, {}, {}, None))
elif MISTAKE == "WrongStamp":
    outbox.stamp = lambda step, token: step.to_bytes(8, "little", signed=True) + b"another"
elif MISTAKE == "WrongLength":
    pack = outbox.Outbox._pack  # noqa: SLF001
    outbox.Outbox._pack = lambda self, step, ports, bulk, *more: pack(  # noqa: SLF001
        self, step, ports, {port: size + 1 for port, size in bulk.items()}, *more
    )
elif MISTAKE == "WrongSlot":
    write = slots.SlotWriter.write
    slots.SlotWriter.write = lambda self, step, content: write(self, step + 1, content)
elif MISTAKE == "AnySlot":
    slots.SlotContent.decoded = _any_slot
elif MISTAKE in {"AnyRun", "AnyStep"}:
    from stepbus_participant.session import step_loop

    _read_stamp = step_loop.read_stamp
    step_loop.read_stamp = _any_stamp if MISTAKE == "AnyRun" else _any_step

if __name__ == "__main__":
    role = Camera if MISTAKE == "camera" else Eye
    raise SystemExit(stepbus.main(role))
