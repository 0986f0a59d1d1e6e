"""The bytes on the line: what the drive and its driver have to agree on, and nothing else.

A frame is a start byte, its numbers in little-endian, and CRC-8 (polynomial 0x07) over both.
"""

import struct

REQUEST, REPLY = 0xA5, 0x5A
_REQUEST = struct.Struct("<BBi")  # start, number of the request, torque [µN·m]
_REPLY = struct.Struct("<BBqi")  # start, number of the request, position [µrad], velocity [µrad/s]
REQUEST_BYTES, REPLY_BYTES = _REQUEST.size + 1, _REPLY.size + 1


def crc8(data: bytes) -> int:
    """Return the checksum of some bytes."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x07 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def request(number: int, torque: float) -> bytes:
    """Return the frame that asks for a torque [N·m]."""
    body = _REQUEST.pack(REQUEST, number, round(torque * 1e6))
    return body + bytes([crc8(body)])


def reply(number: int, position: float, velocity: float) -> bytes:
    """Return the frame that answers: position [rad], velocity [rad/s]."""
    body = _REPLY.pack(REPLY, number, round(position * 1e6), round(velocity * 1e6))
    return body + bytes([crc8(body)])


def read_request(frame: bytes) -> tuple[int, float]:
    """Return number and torque [N·m]; raises ValueError for a frame that is damaged."""
    start, number, torque = _REQUEST.unpack(_checked(frame))
    if start != REQUEST:
        raise ValueError(f"starts with {start:#04x}, not {REQUEST:#04x}")
    return number, torque * 1e-6


def read_reply(frame: bytes) -> tuple[int, float, float]:
    """Return number, position [rad] and velocity [rad/s]; raises ValueError for a damaged frame."""
    start, number, position, velocity = _REPLY.unpack(_checked(frame))
    if start != REPLY:
        raise ValueError(f"starts with {start:#04x}, not {REPLY:#04x}")
    return number, position * 1e-6, velocity * 1e-6


def _checked(frame: bytes) -> bytes:
    if crc8(frame[:-1]) != frame[-1]:
        raise ValueError(f"{frame.hex(' ')} has another checksum")
    return frame[:-1]
