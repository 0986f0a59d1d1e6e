"""The controller of joints.py, written from docs/protocol.md alone: no import of stepbus."""

import json
import os
import queue
import time
from pathlib import Path

import msgpack
import zenoh

FLUSH_AFTER_S = 0.02


def settings(endpoint):
    """P2."""
    yield "mode", "peer"
    yield "listen/endpoints", endpoint["listen"]
    yield "connect/endpoints", endpoint["connect"]
    yield "connect/timeout_ms", -1
    yield "connect/exit_on_failure", False
    retry = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}
    yield "connect/retry", retry
    yield "scouting/multicast/enabled", False
    yield "scouting/gossip/enabled", False
    yield "transport/shared_memory/enabled", not endpoint["low_latency"]
    if endpoint["low_latency"]:
        yield "transport/unicast/qos/enabled", False
        yield "transport/unicast/lowlatency", True


def open_session(endpoint):
    config = zenoh.Config()
    for path, value in settings(endpoint):
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


class Controller:
    """Proportional, one after the other of P4 to P11; every = 1, publishes last, no bulk."""

    def __init__(self, ticket, session):
        self.name, self.token, self.session = ticket["name"], ticket["token"], session
        self.prefix = f"stepbus/{ticket['run']}/"
        self.upto, self.stop_at, self.started = 0, None, False
        self.batch, self.timing = [], []
        self.alive = session.liveliness().declare_token(self.prefix + f"alive/{self.name}")
        self.welcome = self.join()
        self.inbox = queue.SimpleQueue()
        self.ahead, self.newest, self.held, self.heard = {}, {}, {}, set()
        for port, config in self.welcome["inputs"].items():
            source = config["source"]
            self.ahead[port], self.newest[source] = [], -config.get("every", 1)
        keys = ["start", "trigger", "stop", *(f"out/{source}" for source in self.newest)]
        self.subscribers = [self.subscribe(key) for key in keys]
        self.puts = {kind: self.publisher(kind, kind.capitalize()) for kind in ("log", "ready")}
        self.puts["out"] = self.publisher("out", "Outputs")

    def join(self):
        hello = {"protocol": 1, "name": self.name, "token": self.token, "pid": os.getpid()}
        encoding = "application/msgpack;stepbus.Hello/1"
        while True:
            replies = self.session.get(
                self.prefix + "join", payload=msgpack.packb(hello), encoding=encoding
            )
            for reply in replies:
                return msgpack.unpackb(reply.ok.payload.to_bytes())
            time.sleep(0.05)

    def subscribe(self, key):
        def put(sample):
            self.inbox.put((key, sample.payload.to_bytes()))

        handler = zenoh.handlers.Callback(put, indirect=False)
        return self.session.declare_subscriber(self.prefix + key, handler)

    def publisher(self, kind, type_name):
        publisher = self.session.declare_publisher(
            f"{self.prefix}{kind}/{self.name}",
            encoding=f"application/msgpack;stepbus.{type_name}/1",
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
        return lambda content: publisher.put(msgpack.packb({"token": self.token, **content}))

    def take(self, timeout_s):
        """Take in the next message; return whether there was one."""
        try:
            key, data = self.inbox.get(timeout=timeout_s)
        except queue.Empty:
            return False
        message = msgpack.unpackb(data)
        if message["token"] != self.token:
            return True
        if key == "start":
            self.started = True
        elif key == "trigger":
            self.upto = max(self.upto, message["upto"])
        elif key == "stop":
            self.stop_at = message["at_step"]
        else:
            self.take_outputs(key.removeprefix("out/"), message)
        return True

    def take_outputs(self, source, message):
        self.heard.add(source)
        if message["step"] <= self.newest[source]:
            return
        self.newest[source] = message["step"]
        for port, config in self.welcome["inputs"].items():
            if config["source"] == source and config["port"] in message.get("ports", {}):
                self.ahead[port].append((message["step"], message["ports"][config["port"]]))

    def become_ready(self):
        while not self.started:
            self.puts["out"]({"step": -1, "t_ns": 0})
            unheard = sorted(self.newest.keys() - self.heard)
            self.log(waiting={"step": -1, "sources": unheard} if unheard else None)
            if not unheard:
                described = {"command": {"like": "joint_state"}}
                self.puts["ready"]({"name": self.name, "outputs": described})
            self.take(FLUSH_AFTER_S)

    def log(self, waiting=None):
        content = {"name": self.name, "outputs": self.batch, "timing": self.timing}
        self.puts["log"]({**content, **({"waiting": waiting} if waiting else {})})
        self.batch, self.timing = [], []

    def has(self, step, source, due):
        """Return whether what a step waits for is there: the trigger, or a source's step."""
        return step < self.upto if source is None else self.newest[source] >= due

    def wait(self, step, source=None, due=0):
        """Return True when it is there, False when the run has ended (P11.2)."""
        told = False
        while not self.has(step, source, due):
            if self.stop_at is not None and step >= self.stop_at:
                return False
            if not self.take(FLUSH_AFTER_S) and not told:
                self.log({"step": step, "sources": [source] if source else []})
                told = True
        return True

    def due(self, config, step):
        reach = step - config.get("delay", 0)
        return reach - reach % config.get("every", 1) if reach >= 0 else -(1 << 62)

    def run(self):
        self.become_ready()
        step = 0
        while self.wait(step) and self.one_step(step):
            step += 1
        self.log()

    def one_step(self, step):
        for port, config in self.welcome["inputs"].items():
            source, due = config["source"], self.due(config, step)
            if not self.wait(step, source, due):
                return False
            while self.ahead[port] and self.ahead[port][0][0] <= due:
                _, self.held[port] = self.ahead[port].pop(0)
        outputs = {
            "token": self.token,
            "step": step,
            "t_ns": step * self.welcome["step_ns"],
            "ports": {"command": self.command()},
        }
        self.puts["out"](outputs)
        self.batch.append(outputs)
        self.timing.append((step, 0, 0))
        if len(self.batch) >= self.welcome["batch"]:
            self.log()
        return True

    def command(self):
        wanted = self.held["reference"]["position"] if "reference" in self.held else [0.0, 0.0]
        position = self.held["joint_state"]["position"]
        values = [r - q for r, q in zip(wanted, position, strict=True)]
        return {"mode": "torque", "values": values}


def main():
    ticket = json.loads(Path(os.environ["STEPBUS_TICKET"]).read_text())
    session = open_session(ticket["endpoint"])
    try:
        Controller(ticket, session).run()
    finally:
        session.close()


if __name__ == "__main__":
    main()
