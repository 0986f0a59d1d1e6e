"""Sentences about values and exceptions that are not ours, whatever they do."""

import difflib
from collections.abc import Sequence


def text_of(value: object) -> str:
    """Return the text of a value of the user's, whose `__str__` may fail, as valid Unicode."""
    try:
        text = str(value)
    except Exception as exc:  # noqa: BLE001  code of the user's
        text = f"(its __str__ raised {type(exc).__name__})"
    return valid_unicode(text)


def valid_unicode(text: str) -> str:
    """Return a text in which a lone surrogate, which no message can carry, is written out."""
    return text.encode(errors="backslashreplace").decode()


def error_text(exc: BaseException) -> str:
    """Return what an exception of the user's says, such as `ValueError: the knee`."""
    text, name = text_of(exc), type(exc).__name__
    return f"{name}: {text}" if text else name


def wrong_word(value: object, words: Sequence[object]) -> str:
    """Return why a value is none of some words: `must be a, b or c, not 'd'`."""
    *most, last = names = [str(word) for word in words]
    near = difflib.get_close_matches(str(value), names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"must be {', '.join(most)}{' or ' if most else ''}{last}, not {value!r}{hint}"
