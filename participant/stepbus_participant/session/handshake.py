"""From the admission to the start: handshakes in both directions, then `Ready`."""

from collections.abc import Mapping

from stepbus_participant.bus import Bus
from stepbus_schemas import HANDSHAKE_STEP, Description, Ready, Waiting, encode, encoding_of

from .control import Control
from .outbox import Outbox
from .sources import Source

_REPEAT_S = 0.02


def await_start(
    bus: Bus, ready: Ready, sources: list[Source], outbox: Outbox, control: Control
) -> Mapping[str, Description]:
    """Exchange handshakes with consumers and sources, report ready, and wait for the start (P4.6).

    Everything is repeated until it takes effect, so no message of this phase can be lost for good.
    Returns the descriptions of the inputs. Raises Stopped when the run ends before it starts.
    """
    put_ready = bus.publisher(f"ready/{ready.name}", encoding_of("Ready/1"))
    while control.started is None:
        outbox.send_handshake()
        _accept_handshakes(sources)
        unconnected = [source.name for source in sources if not source.connected]
        if unconnected:
            outbox.flush(Waiting(step=HANDSHAKE_STEP, sources=unconnected))
        else:
            # The empty log proves that link before anything of value travels over it.
            outbox.flush()
            put_ready(encode(ready))
        control.wait(_REPEAT_S)
    return control.started.get(ready.name, {})


def _accept_handshakes(sources: list[Source]) -> None:
    for source in sources:
        # What follows the first handshake, with its bulk content, is for the step loop (P4.9).
        while not source.connected and not source.queue.empty():
            data = source.queue.get()  # no time-out: it is not empty
            if data is not None:
                source.accept(data)
