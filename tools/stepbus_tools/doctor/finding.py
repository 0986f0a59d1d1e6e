"""One finding of the doctor."""

from typing import Literal

import msgspec

Verdict = Literal["ok", "warn", "fail"]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check.

    warn: runs are slower, or something is missing that not everybody needs. fail: runs do not work.
    """

    what: str
    verdict: Verdict
    text: str
