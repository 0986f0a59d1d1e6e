"""The ZeroMQ remote API: protocol 2 of CoppeliaSim 4.6 and later, and protocol 1 before it."""

from collections.abc import Iterable, Mapping
from typing import Any

import cbor2
import zmq
from zmq.utils.monitor import recv_monitor_message

from stepbus_coppelia.clients import ApiError, Client, Simulator
from stepbus_coppelia.functions import CONSTANTS, NAMES, UNAVAILABLE
from stepbus_participant import WiringError

VERSION = 2
_MODULES = {"sim": NAMES | UNAVAILABLE, "zmqRemoteApi": {"info", "require"}}


class ZmqClient(Client):
    """A client: its identity at the socket, and what is sent to it when it has waited."""

    def __init__(self, name: str, identity: bytes, file: int) -> None:
        super().__init__(name)
        self.identity, self.file = identity, file
        self.reply: Mapping[str, Any] | None = None


class ZmqEndpoint:
    """Answers the clients of one port, on loopback only.

    Raises WiringError where the port is taken.
    """

    def __init__(self, simulator: Simulator, port: int) -> None:
        self._simulator = simulator
        self._context = zmq.Context()
        self._router, self._steps = map(self._context.socket, (zmq.ROUTER, zmq.PUB))
        self._router.setsockopt(zmq.MAXMSGSIZE, 64 << 20)  # bytes of a message that is read
        self._router.setsockopt(zmq.SNDTIMEO, 0)
        self._clients: dict[bytes, ZmqClient] = {}
        self._count = 0
        try:
            self._router.bind(f"tcp://127.0.0.1:{port or '*'}")
            self.port = int(str(self._router.last_endpoint).rstrip("'").rpartition(":")[2])
            # Protocol 1 announces steps there; a port that is found has a free one beside it only
            # by chance.
            self._steps.bind(f"tcp://127.0.0.1:{port + 1 if port else '*'}")
        except zmq.ZMQError as exc:
            self.close()
            raise WiringError(
                f"cannot listen on port {port} or {port + 1} of this machine: {exc.strerror}; is "
                "CoppeliaSim running? Choose another with --port"
            ) from exc
        self._monitor = self._router.get_monitor_socket(zmq.EVENT_DISCONNECTED)

    def sockets(self) -> Iterable[Any]:
        """Return what is polled for reading."""
        return self._router, self._monitor

    def receive(self, socket: Any) -> None:
        """Take and answer what has arrived at a socket, without waiting."""
        if socket is self._monitor:
            file = recv_monitor_message(self._monitor)["value"]
            for client in [c for c in self._clients.values() if c.file == file]:
                self._drop(client, "")  # its connection has ended
            return
        frames = self._router.recv_multipart(copy=False)
        identity = frames[0].bytes
        if (known := self._clients.get(identity)) is None:
            try:
                file = frames[0].get(zmq.SRCFD)
            except zmq.ZMQError:
                return  # bytes that ZeroMQ took for its first protocol, which names no connection
            known = ZmqClient(f"client {self._count + 1} (ZeroMQ)", identity, file)
        if len(frames) != 3 or frames[1].bytes:
            self._drop(known, "has sent what is no request of ZeroMQ's REQ")
        else:
            self._answer(known, frames[2].bytes)

    def _answer(self, client: ZmqClient, data: bytes) -> None:
        try:
            request = cbor2.loads(data)
        except Exception:  # noqa: BLE001  whatever a library makes of bytes that are no CBOR
            request = None
        if not isinstance(request, dict) or not isinstance(request.get("func"), str):
            error = "not a request of the remote API, in CBOR"
            self._send(client, {"err": error, "success": False})
            self._drop(client, "has sent what is no request of the remote API")
            return
        if isinstance(version := request.get("ver", VERSION), int) and version > VERSION:
            self._send(client, {"err": f"stepbus speaks version {VERSION}, the client {version}."})
            return
        if client.identity not in self._clients:
            # Not before it has made sense: a simulation ends when all clients have left.
            self._count += 1
            self._clients[client.identity] = client
            self._simulator.join(client)
        is_old, name, args = "uuid" not in request, request["func"], request.get("args", [])
        if name == "_*end*_":
            self._send(client, {})  # Octave's client waits for it
            self._drop(client, "")
            return
        if name == "_*executed*_":
            self._send(client, {"ret": []})
            return
        args = list(args) if isinstance(args, list | tuple) else [args]
        try:
            result = self._call(client, name, args, is_old=is_old)
        except ApiError as exc:
            coded = str(exc).replace("\n", "_=NL=_").replace("\t", "_=TB=_")
            self._send(client, {"success": False, "error": str(exc)} if is_old else {"err": coded})
            return
        reply = {"success": True, "ret": result} if is_old else {"ret": result}
        if client.waits and not is_old:
            client.reply = reply
        else:
            self._send(client, reply)

    def _call(self, client: ZmqClient, name: str, args: list[Any], *, is_old: bool) -> list[Any]:
        """Call a function; raises ApiError."""
        module, _, own = name.rpartition(".")
        if is_old and name in ("setStepping", "step"):
            # With the client's uuid as the last argument; `step` is answered at once, and then the
            # client waits for the number of the step on the next port.
            return self._simulator.call(client, name, args[:-1] if name == "setStepping" else [])
        if name == "zmqRemoteApi.info":
            return [self._info(str(args[0]) if args else "")]
        if name == "zmqRemoteApi.require":
            if (what := args[0] if args else "nothing") not in tuple(_MODULES):
                raise ApiError(f"plugin {what!r} is not available in stepbus; `sim` is")
            return []
        if module != "sim":
            raise ApiError(f"No such function: {name}; stepbus has those of `sim`")
        return self._simulator.call(client, own, args)

    def _info(self, module: str) -> Mapping[str, Any]:
        if module not in _MODULES:
            raise ApiError(f"{module!r} is not available in stepbus; `sim` is")
        constants = CONSTANTS.items() if module == "sim" else ()
        table: dict[str, Any] = {name: {"func": {}} for name in sorted(_MODULES[module])}
        return table | {name: {"const": value} for name, value in constants}

    def _send(self, client: ZmqClient, reply: Mapping[str, Any]) -> None:
        data = cbor2.dumps(reply)
        try:
            self._router.send_multipart([client.identity, b"", data])
        except zmq.Again:
            self._drop(client, "does not read its answers")

    def stepped(self) -> None:
        """Answer who waited: a step is done, or the simulation has started or stopped."""
        for client in list(self._clients.values()):
            if client.reply is not None and not client.waits:
                self._send(client, client.reply)
                client.reply = None
        self._steps.send(cbor2.dumps(self._simulator.step), zmq.NOBLOCK)

    def _drop(self, client: ZmqClient, why: str) -> None:
        if self._clients.pop(client.identity, None) is not None:
            self._simulator.leave(client, why)

    def close(self) -> None:
        """Close all connections."""
        # With the monitor's socket: it would wait for that for ever. Answers have 200 ms to leave.
        self._context.destroy(linger=200)
