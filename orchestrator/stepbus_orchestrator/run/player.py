"""Plays participants that are absent: what is recorded, scripted or held for them."""

from collections.abc import Callable, Iterable, Mapping

import msgspec

from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import stamp
from stepbus_schemas import HANDSHAKE_STEP, Outputs, encode

Ports = Mapping[str, bytes]
"""Port → the bytes of its message, or of its bulk content."""

Put = Callable[..., None]
"""Publishes bytes on a key; takes `attachment=` bytes too."""


class Player:
    """Publishes in place of participants; for their readers nothing changes.

    specs: the played participants. step_ns: length of a step [ns]. token: of the run. publisher:
    returns, for a key and a message type, the function that publishes there. puts: participant →
    publishes `Outputs`. content_puts: participant → bulk port → publishes its content.
    """

    def __init__(
        self,
        specs: Iterable[ParticipantSpec],
        step_ns: int,
        token: str,
        publisher: Callable[[str, str], Put],
    ) -> None:
        self._step_ns = step_ns
        self._token = token
        self.puts: dict[str, Put] = {}
        self.content_puts: dict[str, dict[str, Put]] = {}
        for spec in specs:
            self.puts[spec.name] = publisher(f"out/{spec.name}", "Outputs/1")
            self.content_puts[spec.name] = {
                port: publisher(f"bulk/{spec.name}/{port}", output.type)
                for port, output in spec.outputs.items()
                if output.bulk
            }

    def send_handshake(self) -> None:
        """Publish the handshakes of all participants, and of their bulk ports (P4.6)."""
        for name, content_puts in self.content_puts.items():
            self.publish(name, HANDSHAKE_STEP, {})
            for port in content_puts:
                self.publish_content(name, port, HANDSHAKE_STEP, b"")

    def publish(self, name: str, step: int, ports: Ports) -> bytes:
        """Publish the messages of a step, bulk content first; return the bytes of the `Outputs`."""
        outputs, content = self.outputs(name, step, ports)
        for port, data in content.items():
            self.publish_content(name, port, step, data)
        packed = encode(outputs)
        self.puts[name](packed)
        return packed

    def publish_content(
        self, name: str, port: str, step: int, data: bytes, token: str | None = None
    ) -> None:
        """Publish the content of a bulk port; token: default: that of the run."""
        self.content_puts[name][port](data, attachment=stamp(step, token or self._token))

    def outputs(
        self, name: str, step: int, ports: Ports, token: str | None = None
    ) -> tuple[Outputs, dict[str, bytes]]:
        """Return the `Outputs` of a step, and the bulk content that it announces (P7.3).

        token: default: that of the run.
        """
        bulk = self.content_puts[name]
        content = {port: data for port, data in ports.items() if port in bulk}
        outputs = Outputs(
            token=token or self._token,
            step=step,
            t_ns=max(step, 0) * self._step_ns,
            ports={port: msgspec.Raw(data) for port, data in ports.items() if port not in bulk},
            bulk={port: len(data) for port, data in content.items()},
        )
        return outputs, content
