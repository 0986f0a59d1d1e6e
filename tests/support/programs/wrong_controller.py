"""The controller of by_the_page.py with one mistake: `wrong_controller.py MISTAKE`."""

import contextlib
import itertools
import math
import os
import random
import signal
import sys
import time

import by_the_page
from by_the_page import CHECKS, NEVER, NUMBERS, Controller, Malformed, Source


class WrongToken(Controller):
    def hello(self):
        return {**super().hello(), "token": "0123456789abcdef"}


class WrongPorts(Controller):
    def hello(self):
        return {**super().hello(), "inputs": {"joint_state": "JointState/2"}}


class HandshakesOnce(Controller):
    def publisher(self, kind, type_name):
        put, sent = super().publisher(kind, type_name), []

        def put_once(content):
            if content.get("step") != -1 or not sent:
                put(content)
            sent.append(content)

        return put_once if kind == "out" else put


class LaterStart(Controller):
    """Takes each Start for the first."""

    def take_control(self, key, data):
        super().take_control(key, data)
        if key == "start":
            # Never without one in between: the steps read it in another thread.
            with contextlib.suppress(by_the_page.Malformed):
                message = by_the_page.check(by_the_page.unpack(data), "Start")
                if message["token"] == self.token:
                    self.start = message["inputs"].get(self.name, {}) or self.start


class NoText(Controller):
    """Adds a field that nobody knows to its log, with a string that is no UTF-8."""

    def publisher(self, kind, type_name):
        put = super().publisher(kind, type_name)
        return put if kind == "out" else lambda content: put({**content, "comment": "\udcff"})


class FiresAlways(Controller):
    def next_step(self):
        return self.step + 1


class IgnoresTerm(Controller):
    def run(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        return super().run()


class AsksForever(Controller):
    def join(self, timeout_s):
        return super().join(1000.0)


class AsksOne(Controller):
    """Asks the one that Zenoh picks."""

    target = by_the_page.zenoh.QueryTarget.BEST_MATCHING

    def query(self, timeout_s):
        hello = by_the_page.msgpack.packb(self.hello())
        key = self.prefix + "join"
        return self.session.get(key, payload=hello, timeout=timeout_s, target=self.target)


class Consolidates(AsksOne):
    """Asks all, but lets Zenoh keep one reply."""

    target = by_the_page.zenoh.QueryTarget.ALL


class FirstReply(Controller):
    """Takes the first reply for the only one."""

    def query(self, timeout_s):
        return itertools.islice(super().query(timeout_s), 1)


class AnyWelcome(Controller):
    def check_welcome(self, answer):
        return answer


class TicketNumber(Controller):
    """Claims to speak the highest protocol of its ticket."""

    def __init__(self, ticket, session):
        self.lowest = self.highest = ticket["protocols"]["highest"]
        super().__init__(ticket, session)


class NoHandshakes(Controller):
    """Ready at once, without its sources."""

    def become_ready(self):
        for source in self.sources.values():
            source.connected = True
        super().become_ready()


class WrongLimits(Controller):
    def publisher(self, kind, type_name):
        put = super().publisher(kind, type_name)
        described = {"command": {"like": "joint_state", "limits": {"effort": [1.0, 2.0, 3.0]}}}
        return put if kind != "ready" else lambda content: put({**content, "outputs": described})


class WrongEncoding(Controller):
    def publisher(self, kind, type_name):
        return super().publisher(kind, "Outputs" if kind == "log" else type_name)


class StepsMissing(Controller):
    def publish(self, step, ports):
        if step != 5:
            super().publish(step, ports)


class TwiceDifferent(Controller):
    def publish(self, step, ports):
        super().publish(step, ports)
        t_ns = step * self.welcome["step_ns"]
        self.puts["out"]({"step": step, "t_ns": t_ns, "ports": {}})


class WrongTime(Controller):
    def publish(self, step, ports):
        super().publish(step, ports)
        self.welcome["step_ns"] += 1


class StrangerOutputs(Controller):
    def publisher(self, kind, type_name):
        put = super().publisher(kind, type_name)
        if kind != "out":
            return put
        return lambda m: put({**m, "token": "abcd"} if m["step"] >= 0 else m)


class Mistyped(Controller):
    def command(self):
        return {"mode": "torque", "values": "many"}


class NoLog(Controller):
    def log(self, waiting=None):
        self.batch, self.timing = [], []
        super().log(waiting)


class BigBatches(Controller):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.welcome["batch"] = 1000


class Random(Controller):
    def command(self):
        command = super().command()
        return {**command, "values": [value + random.random() for value in command["values"]]}


class Clock(Controller):
    def command(self):
        command = super().command()
        return {**command, "values": [value * time.time() for value in command["values"]]}


class IgnoresTriggers(Controller):
    def wait_for_trigger(self, step):
        return True


class LastTrigger(Controller):
    """Takes the last trigger for the largest."""

    def take_control(self, key, data):
        if key == "trigger":
            self.step_limit = 0
        super().take_control(key, data)


class Silent(Controller):
    """Never says what it waits for."""

    def log(self, waiting=None):
        super().log(waiting if waiting and waiting["step"] < 0 else None)


class TakesNewest(Controller):
    """Takes the newest message rather than the due one."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        for source in self.sources.values():
            settle = source.settle
            source.settle = lambda name, due, settle=settle: settle(name, NEVER)


class IgnoresDelay(Controller):
    def due(self, config, step):
        return super().due({**config, "delay": 0}, step)


class RoundsToZero(Controller):
    """Rounds as C does: step −1 down to step 0."""

    def due(self, config, step):
        reach = step - config.get("delay", 0)
        return reach - int(math.fmod(reach, config.get("every", 1)))


class ForgetsInputs(Controller):
    """Does not hold; then it has nothing to work with."""

    def read_inputs(self, step):
        self.held = {}
        return super().read_inputs(step)


class ZerosForHeld(Controller):
    """Does not hold; then it takes zeros."""

    def read_inputs(self, step):
        zeros = {"position": [0.0, 0.0], "velocity": [0.0, 0.0], "acceleration": [0.0, 0.0]}
        self.held = dict.fromkeys(self.inputs, zeros)
        return super().read_inputs(step)


class FixedOrder(Controller):
    def reference(self):
        return self.held["reference"]["position"] if "reference" in self.held else None


class IgnoresStop(Controller):
    def take_control(self, key, data):
        if key != "stop":
            super().take_control(key, data)


class AnyStop(Controller):
    """Stops for anybody."""

    def take_control(self, key, data):
        if key == "stop":
            self.stop_at = -1
        super().take_control(key, data)


class StopsAtOnce(Controller):
    """Leaves out the step that a Stop overtakes."""

    def take_control(self, key, data):
        super().take_control(key, data)
        if key == "stop" and self.stop_at != NEVER:
            self.stop_at = -1


class ExitsThree(Controller):
    def finish(self):
        super().finish()
        return 3


class Unwatchful(Controller):
    def watch(self):
        return None


class SilentFaults(Controller):
    def report(self, exc):
        return 1


class ForgivingSource(Source):
    """Takes a changed duplicate for an equal one."""

    def take_step(self, step, message, data):
        if step != self.newest:
            super().take_step(step, message, data)


class ImpatientSource(Source):
    """Takes an equal or older step for a fault."""

    def drop(self, cause):
        if cause in {"duplicate", "stale"}:
            raise self.fault(f"sent a {cause}")
        super().drop(cause)


class TrustingSource(Source):
    """Takes any token for the right one."""

    def take(self, data):
        with contextlib.suppress(Malformed):
            self.token = by_the_page.check(by_the_page.unpack(data), "Outputs")["token"]
        super().take(data)


class BatchSource(Source):
    """Takes the last step of a batch only, as if it were the one that is due."""

    def take(self, data):
        message = None
        with contextlib.suppress(Malformed):
            message = by_the_page.unpack(data)
        if not isinstance(message, dict) or "outputs" not in message:
            super().take(data)
            return
        last = message["outputs"][-1]
        super().take(by_the_page.msgpack.packb({**last, "step": self.newest + self.every}))


class LosesBatches(Controller):
    """Says that it takes batches."""

    def hello(self):
        return {**super().hello(), "batches": True}


class NarrowSource(Source):
    """Takes a port that it does not know for a fault."""

    def take_step(self, step, message, data):
        known = {config["port"] for config in self.inputs.values()}
        if message.get("ports", {}).keys() - known:
            raise self.fault("sent an unknown port")
        super().take_step(step, message, data)


class FreezingSource(Source):
    def take(self, data):
        if len(data) > 30_000:
            os.kill(os.getpid(), signal.SIGSTOP)
        super().take(data)


class HangingSource(Source):
    def drop(self, cause):
        if cause == "malformed":
            time.sleep(1000)
        super().drop(cause)


MISTAKES = {
    cls.__name__: cls
    for cls in (
        WrongToken, WrongPorts, AsksOne, FirstReply, Consolidates, HandshakesOnce, LaterStart, FiresAlways, IgnoresTerm, AsksForever, AnyWelcome, NoHandshakes, WrongLimits,
        WrongEncoding, StepsMissing, TwiceDifferent, WrongTime, StrangerOutputs, Mistyped, NoLog,
        BigBatches, Random, Clock, IgnoresTriggers, LastTrigger, Silent, TakesNewest, IgnoresDelay, RoundsToZero,
        ForgetsInputs, ZerosForHeld, FixedOrder, IgnoresStop, AnyStop, StopsAtOnce,
        ExitsThree, Unwatchful, SilentFaults, LosesBatches, NoText, TicketNumber,
    )
}  # fmt: skip


def strict_fields(message, type_name, check=by_the_page.check):
    """Refuse fields that are not known."""
    required, optional = by_the_page.TYPES[type_name]
    if type_name.endswith("/1") and isinstance(message, dict):
        unknown = [name for name in message if name not in {**required, **optional}]
        if unknown:
            raise Malformed(f"no {type_name}: {unknown[0]} is unknown")
    return check(message, type_name)


SOURCES = {
    "AnyToken": TrustingSource,
    "LosesBatches": BatchSource,
    "KnownPorts": NarrowSource,
    "NoDuplicates": ImpatientSource,
    "ForgivesDuplicates": ForgivingSource,
    "FreezesAtLarge": FreezingSource,
    "HangsAtGarbage": HangingSource,
}


def main(mistake):
    if mistake == "ExitsZeroWithoutTicket" and "STEPBUS_TICKET" not in os.environ:
        return 0
    if mistake == "OnlyFloats":
        CHECKS[NUMBERS] = lambda value: (
            isinstance(value, list) and all(isinstance(item, float) for item in value)
        )
    if mistake == "StrictFields":
        by_the_page.check = strict_fields
    by_the_page.Source = SOURCES.get(mistake, Source)
    return by_the_page.main(MISTAKES.get(mistake, Controller))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1]))
