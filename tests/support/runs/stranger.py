"""Somebody who has stolen the tickets of a run, and talks while one participant is frozen."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from support.runs.joints import run_joints

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_participant import Endpoint, ZenohBus, load_ticket
from stepbus_schemas import encode, encoding_of

PATIENT = ("duration=2s", "window=2", "batch=1", *(f"{who}.step_timeout=60s" for who in ("plant", "controller", "mission")))  # fmt: skip
WAIT_S = 30.0


class Stranger(RunExtension):
    """Acts once, while the controller is frozen: so it is in the middle of the run.

    It has the credentials of every participant, without which there is no link at all, and
    publishes on each key as its owner. act: is given the stranger and the run's token.
    """

    def __init__(self, temp, act):
        self.temp, self.act = temp, act
        self.acted = False
        self.pace = Pace(at=20)
        self.over = threading.Event()
        self.publishers = {}
        self.pids = {}
        self.pool = ThreadPoolExecutor()

    def started(self, participant):
        self.pids[participant.name] = participant.process.pid
        if len(self.pids) == 3:
            self.visit = self.pool.submit(self.come_in)

    def close(self):
        self.over.set()
        self.pool.shutdown()
        self.visit.result()

    def come_in(self):
        (folder,) = self.temp.glob("stepbus-*/")
        tickets = [load_ticket({"STEPBUS_TICKET": str(path)}) for path in folder.glob("*.ticket")]
        links = {link for ticket in tickets for link in (*ticket.endpoint.listen, *ticket.endpoint.connect)}  # fmt: skip
        # The controller is frozen: a session that waits for it closes 10 s late.
        awake = links - set(controller_ticket(tickets).endpoint.listen)
        self.another_session = lambda: open_bus(controller_ticket(tickets), awake)
        self.buses = {ticket.name: open_bus(ticket, links) for ticket in tickets}
        self.bus, self.key = self.buses["controller"], tickets[0].run
        try:
            self.hear_everybody()
            os.kill(self.pids["controller"], signal.SIGSTOP)
            # The run goes on as far as it can without the controller.
            self.pace.resume()
            self.act(self, tickets[0].token)
            # An answer proves that the orchestrator has all that went before, on the same link.
            self.ask(b"")
            self.acted = True
        finally:
            self.pace.resume()
            os.kill(self.pids["controller"], signal.SIGCONT)
            self.over.wait(WAIT_S)
            for bus in self.buses.values():
                bus.close()

    def hear_everybody(self):
        """Step on from the pause until outputs of all have come on each link."""
        heard = [threading.Event() for _ in self.buses for _ in self.buses]
        pairs = [(bus, name) for bus in self.buses.values() for name in self.buses]
        for event, (bus, name) in zip(heard, pairs, strict=True):
            bus.subscribe(f"out/{name}", lambda _sample, event=event: event.set())
        give_up = time.monotonic() + WAIT_S
        while not all(event.wait(0.05) for event in heard):
            if time.monotonic() > give_up:
                raise TimeoutError("the stranger does not hear everybody")
            self.pace.step()

    def say(self, key, data, attachment=b""):
        if key not in self.publishers:
            owner = next((name for name in self.buses if name in key.split("/")), "mission")
            self.publishers[key] = self.buses[owner].publisher(key, encoding_of("Outputs/1"))
        self.publishers[key](data, **({"attachment": attachment} if attachment else {}))

    def say_message(self, key, message):
        if key == "join":
            return self.ask(encode(message))
        return self.say(key, encode(message))

    def ask(self, data):
        """Return the orchestrator's answer to a query on `join`."""
        return next(iter(self.bus.query("join", data, encoding_of("Hello/1"), WAIT_S)), None)


def controller_ticket(tickets):
    return next(ticket for ticket in tickets if ticket.name == "controller")


def open_bus(ticket, links):
    """Return a session with a participant's credentials, linked to everybody."""
    settings = {path: value for path, value in ticket.endpoint.settings.items() if "tls" in path}
    own = {"user": ticket.endpoint.user, "password": ticket.endpoint.password, "settings": settings}
    return ZenohBus(Endpoint(listen=[], connect=sorted(links), **own), ticket.run)


def disturbed(folder, temp, act, *settings):
    """Return the result of a run that a stranger has disturbed."""
    stranger = Stranger(temp, act)
    result = run_joints(
        folder,
        *PATIENT,
        *settings,
        extensions=[stranger.pace, stranger],
    )
    assert stranger.acted, result.reason
    return result
