"""The root of every error stepbus raises, and the words of its messages.

StepbusError
├─ MessageError (ValueError)       a message, or its bytes, that is not what it should be
├─ WiringError (ValueError)        a scenario, port or type that cannot work; known before the run
└─ RunError (RuntimeError)         something that went wrong during a run
"""

from collections.abc import Iterable, Sequence


class StepbusError(Exception):
    """Root of all errors raised by stepbus."""


class MessageError(StepbusError, ValueError):
    """A message, or its bytes on the wire, does not match its type."""


class WiringError(StepbusError, ValueError):
    """A scenario, a port or a message type is invalid."""


class RunError(StepbusError, RuntimeError):
    """A run, or a participant in it, failed."""


_MOST_COMPARED, _MOST_SHOWN, _LONGEST = 1000, 40, 100
_PAIR, _MOST_MEANT = 2, 3


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
    """Return type and text of an exception of the user's, such as `ValueError: the knee`."""
    text, name = text_of(exc), type(exc).__name__
    return f"{name}: {text}" if text else name


def nearest(name: object, known: Iterable[object]) -> str:
    """Return `; did you mean 'x'?`, or nothing where none of the known names is near."""
    # To compare takes time with the length of each, and with their number.
    short = [one for one in list(map(str, known))[:_MOST_COMPARED] if len(one) <= _LONGEST]
    word = str(name)[:_LONGEST].casefold()
    folded = {one.casefold(): one for one in reversed(short)}
    import difflib  # noqa: PLC0415  (only a mistake needs it)

    near = difflib.get_close_matches(word, folded, n=1)
    if not near and len(word) == _PAIR:
        # One letter of two is too little for difflib, and kq for kp the usual slip.
        near = [one for one in reversed(folded) if len(one) == _PAIR and set(one) & set(word)]
    meant = [repr(folded[one]) for one in near[:_MOST_MEANT]]
    return f"; did you mean {listed(meant)}?" if meant else ""


def suggest(name: object, known: Iterable[object]) -> str:
    """Return `; did you mean 'x'?`, or the known names where none is near."""
    names = list(dict.fromkeys(map(str, known)))
    if (near := nearest(name, names)) or not names:
        return near
    more = f" … ({len(names)} in all)" if len(names) > _MOST_SHOWN else ""
    return f"; known: {', '.join(names[:_MOST_SHOWN])}{more}"


def listed(words: Sequence[object]) -> str:
    """Return `a, b or c`, truth values as YAML has them."""
    *most, last = (str(word).lower() if isinstance(word, bool) else str(word) for word in words)
    return f"{', '.join(most)} or {last}" if most else last


def wrong_word(value: object, words: Sequence[object]) -> str:
    """Return the error message for a value that is no allowed word: `must be a or b, not 'd'`."""
    return f"must be {listed(words)}, not {value!r}{nearest(value, words)}"
