"""What the doctor says of one thing."""

from __future__ import annotations

from typing import Literal

import msgspec

Verdict = Literal["ok", "warn", "fail"]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was looked at.

    warn: something is slower, or missing that not everybody needs. fail: runs will not work.
    """

    what: str
    verdict: Verdict
    text: str
