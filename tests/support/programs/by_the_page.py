"""The controller of joints.py, written from docs/protocol.md alone: no import of stepbus."""

import json
import os
import queue
import sys
import tempfile
import time
from pathlib import Path

import msgpack
import zenoh

FLUSH_AFTER_S = 0.02
BATCH_AGE_S = 0.05
BATCH_BYTES = 30_000
NEVER = 1 << 62

NUMBERS, TEXT, MAP, INTEGER = "list of numbers", "string", "map", "integer"
STATE_FIELDS = ("position", "velocity", "effort", "target")
REFERENCE_FIELDS = ("position", "velocity", "acceleration")
# Type → (fields that have to be there, fields that may be absent or nil).
TYPES = {
    "Welcome": ({"protocol": INTEGER, "name": TEXT, "token": TEXT, "inputs": MAP}, {}),
    "Start": ({"token": TEXT, "inputs": MAP}, {}),
    "Trigger": ({"token": TEXT, "step_limit": INTEGER}, {}),
    "Stop": ({"token": TEXT, "reason": TEXT, "at_step": INTEGER}, {}),
    "Outputs": ({"token": TEXT, "step": INTEGER, "t_ns": INTEGER}, {"ports": MAP, "bulk": MAP, "end": TEXT}),
    "JointState/1": ({}, dict.fromkeys(STATE_FIELDS, NUMBERS)),
    "JointReference/1": (dict.fromkeys(REFERENCE_FIELDS, NUMBERS), {}),
}  # fmt: skip


class Malformed(Exception):
    """Bytes that are not what they should be."""


class Refused(Exception):
    """Not let in, or nobody there (P4.2, P4.3)."""


class Gone(Exception):
    """The orchestrator has gone (P4.4)."""


class Stopped(Exception):
    """Stopped before the start (P11.1)."""


class Fault(Exception):
    """Cannot go on (P10)."""

    def __init__(self, message, type_="raised", blames=None):
        super().__init__(message)
        self.type, self.blames = type_, blames


def is_number(value, kinds=(int, float)):
    return isinstance(value, kinds) and not isinstance(value, bool)


CHECKS = {
    NUMBERS: lambda value: isinstance(value, list) and all(map(is_number, value)),
    TEXT: lambda value: isinstance(value, str),
    MAP: lambda value: isinstance(value, dict),
    INTEGER: lambda value: is_number(value, int),
}


def unpack(data):
    """P3.3."""
    try:
        return msgpack.unpackb(data, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as exc:
        raise Malformed(f"no MessagePack: {exc}") from exc


def check(message, type_name):
    """P3.4."""
    required, optional = TYPES[type_name]
    if not isinstance(message, dict):
        raise Malformed(f"no {type_name}: no map")
    for name, kind in {**required, **optional}.items():
        value = message.get(name)
        if (value is None and name in required) or (value is not None and not CHECKS[kind](value)):
            raise Malformed(f"no {type_name}: {name} is no {kind}")
    return message


def carries(data, token):
    """Return whether malformed bytes are at least a map with the token (P8.1)."""
    try:
        message = unpack(data)
    except Malformed:
        return False
    return isinstance(message, dict) and message.get("token") == token


def settings(endpoint, dictionary):
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
    yield "transport/shared_memory/enabled", False
    yield "transport/link/tx/lease", 3_600_000
    if endpoint["low_latency"]:
        yield "transport/unicast/qos/enabled", False
        yield "transport/unicast/lowlatency", True
    if endpoint.get("user") is not None:
        yield "transport/auth/usrpwd/user", endpoint["user"]
        yield "transport/auth/usrpwd/password", endpoint["password"]
        yield "transport/auth/usrpwd/dictionary_file", dictionary
    yield from endpoint.get("settings", {}).items()


def open_session(endpoint):
    with tempfile.NamedTemporaryFile("w") as dictionary:
        users = endpoint.get("users", {})
        dictionary.writelines(f"{user}:{password}\n" for user, password in users.items())
        dictionary.flush()
        config = zenoh.Config()
        for path, value in settings(endpoint, dictionary.name):
            config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)


class Source:
    """What has come from one source, in the order of its steps (P6, P8)."""

    def __init__(self, name, inputs, token):
        self.name, self.inputs, self.token = name, inputs, token
        self.every = next(iter(inputs.values())).get("every", 1)
        self.connected, self.newest, self.bytes = False, -self.every, b""
        self.ahead = {port: [] for port in inputs}
        self.drops = {}

    def drop(self, cause):
        self.drops[cause] = self.drops.get(cause, 0) + 1

    def take(self, data):
        try:
            message = check(unpack(data), "Outputs")
        except Malformed as exc:
            if carries(data, self.token):
                raise self.fault(f"sent {exc}") from exc
            self.drop("malformed")
            return
        if message["token"] != self.token:
            self.drop("unauthenticated")
        elif message["step"] == -1:
            self.connected = True
        else:
            self.take_step(message["step"], message, data)

    def take_step(self, step, message, data):
        if step == self.newest + self.every:
            self.newest, self.bytes = step, data
            for name, config in self.inputs.items():
                if config["port"] in (message.get("ports") or {}):
                    self.ahead[name].append((step, message["ports"][config["port"]]))
        elif step > self.newest:
            raise self.fault(f"skipped from step {self.newest} to {step}")
        elif step == self.newest and data != self.bytes:
            raise self.fault(f"published step {step} twice, with different bytes")
        else:
            self.drop("duplicate" if step == self.newest else "stale")

    def settle(self, name, due):
        """Return the newest message of an input that is due, None where there is no new one."""
        found = None
        while self.ahead[name] and self.ahead[name][0][0] <= due:
            _, message = self.ahead[name].pop(0)
            try:
                found = check(message, self.inputs[name]["type"])
            except Malformed as exc:
                raise self.fault(f"sent {exc}") from exc
        return found

    def fault(self, what):
        return Fault(f"{self.name} {what}", "message", self.name)


class Controller:
    """Proportional, one after the other of P4 to P11; publishes last, no bulk, no calls."""

    lowest = highest = 2

    def __init__(self, ticket, session):
        self.name, self.token, self.session = ticket["name"], ticket["token"], session
        self.prefix = f"stepbus/{ticket['run']}/"
        self.step_limit, self.stop_at, self.start, self.unauthenticated, self.step = (
            0,
            NEVER,
            None,
            0,
            -1,
        )
        self.batch, self.batch_bytes, self.batch_began, self.timing = [], 0, 0.0, []
        self.inbox, self.held = queue.SimpleQueue(), {}
        self.alive = session.liveliness().declare_token(self.prefix + f"alive/{self.name}")
        self.watched = self.watch()
        self.welcome = self.join(ticket.get("join_timeout_s", 10.0))
        self.inputs = self.welcome["inputs"]
        self.sources = self.make_sources()
        keys = ["start", "trigger", "stop", *(f"out/{source}" for source in self.sources)]
        self.subscribers = [self.subscribe(key) for key in keys]
        self.puts = {
            kind: self.publisher(kind, kind.capitalize()) for kind in ("log", "ready", "fault")
        }
        self.puts["out"] = self.publisher("out", "Outputs")

    # --- P4: joining ---

    def hello(self):
        hello = {
            "protocol": self.highest,
            "name": self.name,
            "token": self.token,
            "pid": os.getpid(),
        }
        return hello if self.lowest == self.highest else {**hello, "lowest_protocol": self.lowest}

    def query(self, timeout_s):
        """Ask all that answer."""
        return self.session.get(
            self.prefix + "join",
            payload=msgpack.packb(self.hello()),
            encoding="application/msgpack;stepbus.Hello/1",
            timeout=timeout_s,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def join(self, timeout_s):
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            refusals = []
            for reply in self.query(timeout_s):
                if reply.ok is not None:
                    try:
                        return self.check_welcome(unpack(reply.ok.payload.to_bytes()))
                    except (Refused, Malformed) as exc:
                        refusals.append(exc)
            if refusals:
                raise refusals[0]
            time.sleep(0.05)
        raise Refused(f"nobody answered within {timeout_s} s")

    def check_welcome(self, answer):
        if isinstance(answer, dict) and "reason" in answer:
            raise Refused(answer["reason"])
        check(answer, "Welcome")
        is_spoken = self.lowest <= answer["protocol"] <= self.highest
        if not is_spoken or (answer["name"], answer["token"]) != (self.name, self.token):
            raise Refused("the Welcome is for somebody else, or of another version")
        return answer

    def make_sources(self):
        names = dict.fromkeys(config["source"] for config in self.inputs.values())
        return {
            source: Source(source, {k: c for k, c in self.inputs.items() if c["source"] == source}, self.token)
            for source in names
        }  # fmt: skip

    def subscribe(self, key):
        def put(sample):
            self.inbox.put((key, sample.payload.to_bytes()))

        handler = zenoh.handlers.Callback(put, indirect=False)
        return self.session.declare_subscriber(self.prefix + key, handler)

    def watch(self):
        def put(sample):
            if sample.kind == zenoh.SampleKind.DELETE:
                self.inbox.put(("gone", b""))

        handler = zenoh.handlers.Callback(put, indirect=False)
        key = self.prefix + "alive/orchestrator"
        return self.session.liveliness().declare_subscriber(key, handler, history=True)

    def publisher(self, kind, type_name):
        publisher = self.session.declare_publisher(
            f"{self.prefix}{kind}/{self.name}",
            encoding=f"application/msgpack;stepbus.{type_name}/1",
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
        return lambda content: publisher.put(
            msgpack.packb({"token": self.token, **content}, unicode_errors="surrogateescape")
        )

    def become_ready(self):
        while self.start is None:
            self.puts["out"]({"step": -1, "t_ns": 0})
            unheard = [source.name for source in self.sources.values() if not source.connected]
            self.log({"step": -1, "sources": unheard} if unheard else None)
            if not unheard:
                described = {"command": {"like": "joint_state"}}
                self.puts["ready"]({"name": self.name, "outputs": described})
            self.take(FLUSH_AFTER_S)
            if self.stop_at < 0:
                raise Stopped

    # --- what comes ---

    def take(self, timeout_s):
        """Take in the next message; return whether there was one."""
        try:
            key, data = self.inbox.get(timeout=timeout_s)
        except queue.Empty:
            return False
        if key == "gone":
            raise Gone("the orchestrator has gone")
        if key.startswith("out/"):
            self.sources[key.removeprefix("out/")].take(data)
        else:
            self.take_control(key, data)
        return True

    def take_control(self, key, data):
        """P8.4."""
        try:
            message = check(unpack(data), key.capitalize())
        except Malformed:
            self.unauthenticated += 1
            return
        if message["token"] != self.token:
            self.unauthenticated += 1
        elif key == "start":
            self.start = self.start or message["inputs"].get(self.name, {})
        elif key == "trigger":
            self.step_limit = max(self.step_limit, message["step_limit"])
        else:
            self.stop_at = message["at_step"]

    # --- the steps ---

    def log(self, waiting=None):
        content = {
            "name": self.name,
            "outputs": self.batch,
            "timing": self.timing,
            "drops": self.drops(),
        }
        self.puts["log"]({**content, **({"waiting": waiting} if waiting else {})})
        self.batch, self.batch_bytes, self.timing = [], 0, []

    def drops(self):
        total = {"unauthenticated": self.unauthenticated} if self.unauthenticated else {}
        for source in self.sources.values():
            for cause, count in source.drops.items():
                total[cause] = total.get(cause, 0) + count
        return total

    def wait(self, step, is_there, sources):
        """Return True when it is there, False when the run has ended (P11.2)."""
        told = False
        while not is_there():
            if step >= self.stop_at:
                return False
            if not self.take(FLUSH_AFTER_S) and not told:
                self.log({"step": step, "sources": sources})
                told = True
        return True

    def wait_for_trigger(self, step):
        return self.wait(step, lambda: step < self.step_limit, [])

    def due(self, config, step):
        reach = step - config.get("delay", 0)
        return reach - reach % config.get("every", 1) if reach >= 0 else -NEVER

    def read_inputs(self, step):
        for name, config in self.inputs.items():
            source, due = self.sources[config["source"]], self.due(config, step)
            if not self.wait(
                step, lambda source=source, due=due: source.newest >= due, [source.name]
            ):
                return False
            found = source.settle(name, due)
            if found is not None:
                self.held[name] = found
        return True

    def run(self):
        """Return the exit code."""
        try:
            self.become_ready()
            while self.step_done(self.next_step()):
                continue
        except Stopped:
            return self.finish()
        except (Fault, Malformed, ValueError, LookupError, TypeError) as exc:
            return self.report(exc)
        return self.finish()

    def finish(self):
        self.log()
        return 0

    def next_step(self):
        return 0 if self.step < 0 else self.step + self.welcome["every"]

    def step_done(self, step):
        """Return whether the step was done, rather than the run over."""
        if not (step < self.stop_at and self.wait_for_trigger(step) and self.read_inputs(step)):
            return False
        self.step = step
        self.publish(step, {"command": self.command()})
        self.timing.append((step, 0, 0))
        if (
            len(self.batch) >= self.welcome["batch"]
            or time.monotonic() - self.batch_began > BATCH_AGE_S
        ):
            self.log()
        return True

    def publish(self, step, ports):
        t_ns = step * self.welcome["step_ns"]
        outputs = {"token": self.token, "step": step, "t_ns": t_ns, "ports": ports}
        size = len(msgpack.packb(outputs))
        if size > self.welcome.get("max_outputs_bytes", 60_000):
            raise Fault(f"step {step}: outputs of {size} bytes are too large", "message")
        self.puts["out"](outputs)
        if self.batch_bytes + size > BATCH_BYTES:
            self.log()
        if not self.batch:
            self.batch_began = time.monotonic()
        self.batch.append(outputs)
        self.batch_bytes += size

    def command(self):
        if "joint_state" not in self.held:
            raise Fault(f"step {self.step}: joint_state is absent")
        position = self.held["joint_state"]["position"]
        wanted = self.reference() or [0.0] * len(position)
        values = [float(r) - float(q) for r, q in zip(wanted, position, strict=True)]
        return {"mode": "torque", "values": values}

    def reference(self):
        """Return the wanted positions in the order of joint_state (P4.8), None while absent."""
        if "reference" not in self.held:
            return None
        wanted = self.held["reference"]["position"]
        given, own = (
            self.start.get(k, {}).get("names") or [] for k in ("reference", "joint_state")
        )
        return [wanted[given.index(name)] for name in own] if given and own else wanted

    # --- P10 ---

    def report(self, exc):
        self.log()
        type_, blames = (exc.type, exc.blames) if isinstance(exc, Fault) else ("raised", None)
        content = {"name": self.name, "step": self.step, "type": type_, "message": str(exc)}
        self.puts["fault"]({**content, **({"blames": blames} if blames else {})})
        print(exc, file=sys.stderr)
        deadline, self.stop_at = time.monotonic() + 1.0, NEVER
        while self.stop_at == NEVER and time.monotonic() < deadline:
            try:
                self.take(FLUSH_AFTER_S)
            except (Fault, Gone):
                continue
        return 1


def main(controller=Controller):
    path = os.environ.get("STEPBUS_TICKET")
    if path is None:
        print("STEPBUS_TICKET is not set", file=sys.stderr)
        return 2
    ticket = json.loads(Path(path).read_text())
    session = open_session(ticket["endpoint"])
    try:
        return controller(ticket, session).run()
    except (Refused, Malformed, Gone) as exc:
        print(exc, file=sys.stderr)
        return 1
    finally:
        session.close()


if __name__ == "__main__":
    raise SystemExit(main())
