"""Stands for the hardware: a motor drive at the far end of a pseudo-terminal.

`python drive.py motor.tty` makes a serial port of that name, and serves it until it is ended. With
each request the motor moves on by one period of 10 ms under the torque asked for, as drives do that
are clocked by their master; so what it answers depends on the requests alone.
"""

import os
import signal
import sys
import tty
from pathlib import Path

from frames import REQUEST, REQUEST_BYTES, read_request, reply

PERIOD = 0.01  # s
INERTIA = 0.01  # kg·m²
FRICTION = 0.02  # N·m·s/rad


class Motor:
    """A wheel with viscous friction; position [rad], velocity [rad/s]."""

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0

    def advance(self, torque: float) -> None:
        """Move on by a period, under a torque [N·m]."""
        self.velocity += PERIOD * (torque - FRICTION * self.velocity) / INERTIA
        self.position += PERIOD * self.velocity


def serve(line: int) -> None:
    """Answer the requests of a line; bytes that begin no frame are skipped, as after noise."""
    motors: list[Motor] = []
    pending = b""
    while True:
        pending += os.read(line, 1024)
        pending = pending[max(0, pending.find(REQUEST)) :]
        while len(pending) >= REQUEST_BYTES:
            frame, pending = pending[:REQUEST_BYTES], pending[REQUEST_BYTES:]
            try:
                number, torque = read_request(frame)
            except ValueError as exc:
                sys.stderr.write(f"{exc}\n")
                continue
            if number == 0:
                motors = [Motor()]  # a new master: home
            elif motors:
                motors[0].advance(torque)
            if motors:
                os.write(line, reply(number, motors[0].position, motors[0].velocity))


def main(port: Path) -> None:
    """Make the port, and serve it."""
    line, far_end = os.openpty()
    tty.setraw(far_end)
    port.unlink(missing_ok=True)
    port.symlink_to(os.ttyname(far_end))
    sys.stdout.write(f"a motor at {port}\n")
    sys.stdout.flush()
    try:
        serve(line)
    finally:
        port.unlink(missing_ok=True)


if __name__ == "__main__":
    # So that the port is removed then, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        main(Path(sys.argv[1]))
    except KeyboardInterrupt:
        sys.exit(130)
