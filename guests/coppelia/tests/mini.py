"""A client of the ZeroMQ remote API in few lines, for scripts of tests."""

import os

import cbor2
import zmq


class RemoteError(Exception):
    """What the server says is wrong."""


class Client:
    """Speaks protocol 2; version 1: protocol 1."""

    def __init__(self, port=None, version=2):
        self.version = version
        port = port or int(os.environ["STEPBUS_COPPELIA_PORT"])
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.REQ)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVTIMEO, 60_000)
        self.socket.connect(f"tcp://127.0.0.1:{port}")

    def call(self, name, *args):
        request = {"func": name, "args": list(args)}
        if self.version == 2:
            request |= {"uuid": "mini", "ver": 2, "lang": "python", "argsL": len(args)}
        self.socket.send(cbor2.dumps(request))
        reply = cbor2.loads(self.socket.recv())
        if "err" in reply or not reply.get("success", True):
            raise RemoteError(reply.get("err") or reply.get("error"))
        results = reply["ret"]
        return results[0] if len(results) == 1 else (tuple(results) or None)

    def close(self):
        self.socket.close()
        self.context.term()

    def __getattr__(self, name):
        return lambda *args: self.call(f"sim.{name}", *args)
