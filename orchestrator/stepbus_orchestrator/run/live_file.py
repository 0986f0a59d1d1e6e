"""How to reach a live run, and calls to it from outside."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import msgspec

from stepbus_orchestrator.errors import BusFailed, indented
from stepbus_orchestrator.run.kernel.admission import LOW_LATENCY_BYTES
from stepbus_participant import BusError, Endpoint, ZenohBus, read_file, write_file
from stepbus_schemas import (
    UNDECODABLE,
    CallReply,
    CallRequest,
    Decoder,
    WiringError,
    encode,
    encoding_of,
    explained,
)

from .extensions.calls import CALL_KEY

LIVE_FILE = ".live.json"
_decode_reply = Decoder(CallReply)
_ANSWER_S = 20.0


class Live(msgspec.Struct, frozen=True, kw_only=True):
    """A live run: its key space, its secret, and how a caller reaches its orchestrator."""

    run: str
    token: str
    endpoint: Endpoint

    def save(self, folder: Path) -> None:
        """Write it into a run's folder, readable by its owner only."""
        with contextlib.suppress(OSError):
            write_file(folder / LIVE_FILE, msgspec.json.encode(self), 0o600)


def forget(folder: Path) -> None:
    """Remove the file of a run that has ended, unless it is no longer that file."""
    with contextlib.suppress(OSError):
        (folder / LIVE_FILE).unlink(missing_ok=True)


def call(
    folder: Path, participant: str = "", method: str = "", args: Sequence[Any] = ()
) -> CallReply:
    """Call a participant of a live run; it answers between two steps.

    folder: of the run. participant: default: the run itself; without a method, the answer's value
    lists all calls. method, args: of the call; numbers, texts, lists, maps.

    Raises WiringError when no run is live there, the call is refused or it is longer than the
    run's transport carries; BusFailed when the run does not answer.
    """
    with Line(folder) as line:
        return line.call(participant, method, args)


class Line:
    """A line to a live run, for several calls.

    Raises WiringError when no run is live in the folder, BusFailed when it cannot be reached.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._live = _read(folder)
        try:
            self._bus = ZenohBus(self._live.endpoint, self._live.run)
        except BusError as exc:
            raise BusFailed(f"{folder}: {exc}; was the run killed?") from exc

    def call(
        self,
        participant: str = "",
        method: str = "",
        args: Sequence[Any] = (),
        timeout_s: float = _ANSWER_S,
    ) -> CallReply:
        """Call a participant, or the run itself; as the function `call`, with a time limit [s]."""
        live = self._live
        request = CallRequest(
            token=live.token, participant=participant, method=method, args=list(args)
        )
        question = _pack(live, request)
        for answer in self._bus.query(CALL_KEY, question, encoding_of("CallRequest/1"), timeout_s):
            reply = _decode_reply(answer)
            if reply.error is not None:
                raise WiringError(indented(reply.error))
            return reply
        raise BusFailed(
            f"{self._folder}: the run does not answer; was it killed? Then "
            "`stepbus recover` repairs its recording"
        )

    def close(self) -> None:
        """Close the line."""
        self._bus.close()

    def __enter__(self) -> Self:
        """Return this line."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the line."""
        self.close()


def _pack(live: Live, request: CallRequest) -> bytes:
    data = encode(request)
    if live.endpoint.low_latency and len(data) > LOW_LATENCY_BYTES:
        raise WiringError(
            f"the call takes {len(data)} bytes, more than the {LOW_LATENCY_BYTES} that "
            "the run's low-latency transport can carry; start it with "
            "--set bus.low_latency=false"
        )
    return data


def _read(folder: Path) -> Live:
    try:
        return msgspec.json.decode(read_file(folder / LIVE_FILE), type=Live)
    except FileNotFoundError as exc:
        raise WiringError(
            f"no live run in {folder}; give the folder of one, e.g. runs/two_link-20260101-120000"
        ) from exc
    except (OSError, *UNDECODABLE) as exc:
        raise WiringError(f"{folder / LIVE_FILE} cannot be read: {explained(exc)}") from exc
