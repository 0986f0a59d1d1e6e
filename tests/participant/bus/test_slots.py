"""Slots of a file hold bulk content until they are due again; a wrong one is found."""

import os
import resource
from functools import partial

import pytest

from stepbus_participant import BusError, SlotError
from stepbus_participant.bus.slots import SlotContent, Slots, SlotWriter, _ReadFile, read_slot
from stepbus_participant.session.inputs import Input
from stepbus_schemas import (
    BytesMessage,
    InputConfig,
    Message,
    OutputConfig,
    Welcome,
    encode,
)


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
        offsets[step] = writer.write(step, [content(step)])
        for held in range(max(0, step - 6), step + 1):
            for take in (read_slot, partial(mapped, file=file_read)):
                assert take(fd, offsets[held], held, len(content(held))) == content(held)
    assert path.stat().st_size < 4 * 7 * len(content(99))


def test_a_slot_that_was_used_again_is_found(file):
    fd, path = file
    writer = SlotWriter(fd, 2, path)
    offsets = [writer.write(step, [b"content"]) for step in range(3)]
    assert offsets[0] == offsets[2] != offsets[1]
    for take in (read_slot, mapped):
        with pytest.raises(SlotError, match="holds step 2 with 7 bytes"):
            take(fd, offsets[0], 0, 7)


def test_what_is_written_while_it_is_decoded_is_found_even_where_it_cannot_be_decoded(file):
    fd, path = file
    writer = SlotWriter(fd, 1, path)
    content = SlotContent(_ReadFile(fd), writer.write(0, [b"content"]), 0, 7)

    def decode(view):
        writer.write(1, [b"another"])
        raise ValueError(view)

    with pytest.raises(SlotError, match="holds step 1 with 7 bytes"):
        content.decoded(decode)


@pytest.mark.parametrize(
    ("offset", "length", "found"),
    [
        (0, 6, "holds step 5 with 7 bytes"),
        (1, 7, "holds step"),
        (1 << 40, 7, "holds nothing"),
        (1 << 63, 7, "cannot be read"),
        (0, 1 << 63, "cannot be read"),
    ],
)
def test_whatever_is_announced_it_is_found_where_it_is_not_so(file, offset, length, found):
    fd, path = file
    SlotWriter(fd, 2, path).write(5, [b"content"])
    for take in (read_slot, mapped):
        with pytest.raises(SlotError, match=found):
            take(fd, offset, 5, length)


def test_a_file_that_was_cut_or_claims_too_much_is_found(file):
    fd, path = file
    offset = SlotWriter(fd, 2, path).write(5, [b"content"])
    os.ftruncate(fd, offset + 20)
    for take in (read_slot, mapped):
        with pytest.raises(SlotError, match="holds step 5 with 7 bytes, or less"):
            take(fd, offset, 5, 7)
    os.pwrite(fd, (5).to_bytes(8, "little") + (1 << 62).to_bytes(8, "little"), 0)
    with pytest.raises(SlotError, match="its slot of 4611686018427387904 bytes cannot be read"):
        read_slot(fd, 0, 5, 1 << 62)


def test_who_writes_finds_that_its_file_was_cut(file):
    fd, path = file
    writer = SlotWriter(fd, 2, path)
    writer.write(5, [b"content"])
    os.ftruncate(fd, 20)
    with pytest.raises(BusError, match=r"process truncated .*/camera.image from 8192 to 20 bytes"):
        writer.write(6, [b"another"])


def test_there_is_room_for_all_slots_or_a_sentence_at_the_first(file):
    fd, path = file
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, before[1]))
    try:
        with pytest.raises(
            BusError, match=r"cannot reserve 20 slots of 0.1 MB in .*camera.image: "
        ):
            SlotWriter(fd, 20, path).write(0, [bytes(100_000)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


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
    item.pending.append((0, SlotContent(_ReadFile(fd), writer.write(0, [data]), 0, len(data))))
    item.settle(0)
    writer.write(1, [data.replace(b"first", b"other")])
    assert item.value.data == b"first"
