"""CRC-32 of bytes that follow one another, from the checksum of each part."""

from functools import cache, lru_cache

_POLYNOMIAL = 0xEDB88320
_ONE = 1 << 31
"""Polynomials over two elements: the highest bit is that of x⁰."""


def crc32_of_both(first: int, second: int, length: int) -> int:
    """Return the checksum of two parts, one behind the other; length: of the second [bytes]."""
    return _times(_zeros(length), first) ^ second


@cache
def _power(exponent: int) -> int:
    """Return x to the power of 2 to the power of an exponent."""
    return _times(_power(exponent - 1), _power(exponent - 1)) if exponent else _ONE >> 1


@lru_cache(64)
def _zeros(length: int) -> int:
    """Return what so many zero bytes multiply a checksum with: x to the power of their bits."""
    product = _ONE
    for exponent in range(length.bit_length()):
        if length >> exponent & 1:
            product = _times(_power(exponent + 3), product)
    return product


def _times(a: int, b: int) -> int:
    """Return the product of two polynomials, modulo that of the checksum."""
    product = 0
    while a:
        if a & _ONE:
            product ^= b
        a = a << 1 & 0xFFFFFFFF
        b = b >> 1 ^ (_POLYNOMIAL if b & 1 else 0)
    return product
