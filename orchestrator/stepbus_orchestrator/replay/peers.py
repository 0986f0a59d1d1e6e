"""Plays the participants around the one that is replayed."""

from collections.abc import Callable, Iterable, Iterator, Mapping

from stepbus_orchestrator.replay.recorded import Recorded, envelope, without_bulk
from stepbus_orchestrator.run.bus import Announcer
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_participant import stamp
from stepbus_schemas import HANDSHAKE_STEP, Outputs, encode


class Speaker:
    """Publishes as one participant. is_read: whether anybody listens.

    key: of its outputs. put: publishes these; None where nobody listens. remote: the orchestrator's
    own subscribers get nothing of it.
    """

    def __init__(
        self, spec: ParticipantSpec, announcer: Announcer, *, is_read: bool, remote: bool = False
    ) -> None:
        self.name = spec.name
        self.key = f"out/{spec.name}"
        self.put: Callable[..., None] | None = None
        self._put_bulk: Mapping[str, Callable[..., None]] = {}
        if is_read:
            self.put = announcer.publisher(self.key, "Outputs/1", remote=remote)
            self._put_bulk = {
                port: announcer.publisher(f"bulk/{spec.name}/{port}", output.type, remote=remote)
                for port, output in spec.outputs.items()
                if output.bulk
            }

    def bulk_puts(self) -> Iterator[tuple[str, Callable[..., None]]]:
        """Yield the key of each bulk port with the function that publishes on it."""
        for port, put in self._put_bulk.items():
            yield f"bulk/{self.name}/{port}", put

    def send_handshake(self, token: str) -> None:
        """Prove the connection, before the first step."""
        if self.put is not None:
            self.put(encode(Outputs(token=token, step=HANDSHAKE_STEP, t_ns=0)))
            for put in self._put_bulk.values():
                put(b"", attachment=stamp(HANDSHAKE_STEP, token))

    def publish(self, outputs: Outputs) -> None:
        """Publish the outputs of a step, bulk content first."""
        if self.put is None:
            return
        if self._put_bulk:
            outputs, content = without_bulk(outputs, self._put_bulk)
            for port, data in content.items():
                self._put_bulk[port](data, attachment=stamp(outputs.step, outputs.token))
        self.put(encode(outputs))


class Peer(Speaker):
    """One participant that is played from the recording."""

    def __init__(
        self, spec: ParticipantSpec, recorded: Recorded, announcer: Announcer, *, is_read: bool
    ) -> None:
        super().__init__(spec, announcer, is_read=is_read)
        self.recorded = recorded


class Peers:
    """All participants but the one that is replayed.

    take: is given what each of them publishes, for a new reference recording.
    """

    def __init__(
        self,
        peers: Iterable[Peer],
        *,
        token: str,
        step_ns: int,
        take: Callable[[str, Outputs], None] | None,
    ) -> None:
        self._peers = list(peers)
        self.names = {peer.name for peer in self._peers}
        self._token = token
        self._step_ns = step_ns
        self._take = take

    def send_handshake(self) -> None:
        """Let every peer prove its connection."""
        for peer in self._peers:
            peer.send_handshake(self._token)

    def publish_below(self, step: int, reported: dict[str, int]) -> None:
        """Publish all outputs of steps below `step`; record in `reported` how far each peer is."""
        for peer in self._peers:
            while peer.recorded.step < step:
                reported[peer.name] = peer.recorded.step
                self._publish(peer)

    def close(self, step: int, names: Iterable[str], reported: dict[str, int]) -> None:
        """Take what those named have recorded as the result of the last step."""
        closing = set(names)
        for peer in self._peers:
            if peer.name in closing and peer.recorded.step == step:
                self._publish(peer)
            reported[peer.name] = max(step, reported[peer.name])

    def _publish(self, peer: Peer) -> None:
        step = peer.recorded.step
        outputs = envelope(self._token, step, self._step_ns, peer.recorded.take())
        peer.publish(outputs)
        if self._take is not None:
            self._take(peer.name, outputs)
