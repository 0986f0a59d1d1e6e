"""Slots of a file hold bulk content until they are due again; a wrong one is found."""

import os
from functools import partial

import pytest

from stepbus_participant import SlotError
from stepbus_participant.bus.slots import SlotContent, Slots, SlotWriter, _ReadFile, read_slot
from stepbus_participant.inputs import Input
from stepbus_schemas import BytesMessage, InputConfig, Message, OutputConfig, Welcome, encode


@pytest.fixture
def file(tmp_path):
    fd = os.open(tmp_path / "camera.image", os.O_RDWR | os.O_CREAT)
    yield fd, tmp_path / "camera.image"
    os.close(fd)


def content(step):
    return bytes([step % 251]) * (1000 + 10 * step * step)


def mapped(fd, offset, step, length, file=None):
    return SlotContent(file or _ReadFile(fd), offset, step, length).decoded(bytes)


def test_as_many_steps_as_there_are_slots_can_be_read_while_the_content_grows(file):
    fd, path = file
    writer, offsets, file_read = SlotWriter(fd, 7, path), {}, _ReadFile(fd)
    for step in range(100):
        offsets[step] = writer.write(step, content(step))
        for held in range(max(0, step - 6), step + 1):
            for take in (read_slot, partial(mapped, file=file_read)):
                assert take(fd, offsets[held], held, len(content(held))) == content(held)
    assert path.stat().st_size < 4 * 7 * len(content(99))


def test_a_slot_that_was_used_again_is_found(file):
    fd, path = file
    writer = SlotWriter(fd, 2, path)
    offsets = [writer.write(step, b"content") for step in range(3)]
    assert offsets[0] == offsets[2] != offsets[1]
    for take in (read_slot, mapped):
        with pytest.raises(SlotError, match="does not hold the 7 bytes of step 0"):
            take(fd, offsets[0], 0, 7)


def test_what_is_written_while_it_is_decoded_is_found_even_where_it_cannot_be_decoded(file):
    fd, path = file
    writer = SlotWriter(fd, 1, path)
    content = SlotContent(_ReadFile(fd), writer.write(0, b"content"), 0, 7)

    def decode(view):
        writer.write(1, b"another")
        raise ValueError(view)

    with pytest.raises(SlotError, match="does not hold the 7 bytes of step 0"):
        content.decoded(decode)


@pytest.mark.parametrize(
    ("offset", "length", "found"),
    [
        (0, 6, "does not hold the 6 bytes of step 5"),
        (1, 7, "does not hold"),
        (1 << 40, 7, "does not hold"),
        (1 << 63, 7, "cannot be read|does not hold"),
        (0, 1 << 63, "cannot be read"),
    ],
)
def test_whatever_is_announced_it_is_found_where_it_is_not_so(file, offset, length, found):
    fd, path = file
    SlotWriter(fd, 2, path).write(5, b"content")
    for take in (read_slot, mapped):
        with pytest.raises(SlotError, match=found):
            take(fd, offset, 5, length)


def test_a_participant_opens_what_it_can_and_reads_nothing_else(tmp_path):
    (tmp_path / "camera.image").touch()
    (tmp_path / "eye.copy").symlink_to(tmp_path / "camera.image")
    welcome = Welcome(
        protocol=2, name="eye", token="00", step_ns=1, every=1, publishes="last", window=1, batch=1,
        seed=0, params={}, folder="/",
        inputs={port: InputConfig(source="camera", port=port, type="Image/1", bulk=port != "small")
                for port in ("image", "depth", "small")},
        outputs={"copy": OutputConfig(type="Image/1", bulk=True)},
    )  # fmt: skip
    assert Slots("", welcome).names == []
    slots = Slots(str(tmp_path), welcome)
    assert slots.names == ["camera.image"]
    with pytest.raises(SlotError, match="no slots were negotiated"):
        slots.content("camera", "depth", offset=0, step=0, length=1)
    slots.close()


class Viewed(Message):
    TYPE = "Viewed/1"
    data: memoryview


@pytest.mark.parametrize("name", ["Bytes/1", "Viewed/1"])
def test_a_message_outlasts_its_slot_even_where_its_class_has_views(file, name):
    fd, path = file
    writer, data = SlotWriter(fd, 1, path), encode(BytesMessage(data=b"first"))
    config = InputConfig(source="camera", port="image", type=name, bulk=True)
    item = Input("image", config, {"Bytes/1": BytesMessage, "Viewed/1": Viewed})
    item.pending.append((0, SlotContent(_ReadFile(fd), writer.write(0, data), 0, len(data))))
    item.settle(0)
    writer.write(1, data.replace(b"first", b"other"))
    assert item.value.data == b"first"
