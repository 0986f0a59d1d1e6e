"""Takes part on behalf of a motor behind a serial port: one request and one reply for each step."""

from collections.abc import Mapping

import serial
from frames import REPLY_BYTES, read_reply, request

import stepbus
from stepbus import Config, Description, JointCommand, JointState, Step
from stepbus.params import Duration


class Params(stepbus.Settings):
    """Parameters of the motor."""

    port: str
    """The serial port, such as /dev/ttyUSB0."""
    baud: int = 115200
    """[bit/s]"""
    timeout_ns: Duration = 1_000_000_000
    """How long a reply may take."""


class SerialMotor(stepbus.Participant):
    """Publishes what the motor measures, and sends it the torque that it reads."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        params = config.read(Params)
        # Relative names are relative to the scenario's folder, as all in `params` are.
        path = str(config.folder / params.port)
        timeout = params.timeout_ns * 1e-9
        try:
            self.line = serial.Serial(path, params.baud, timeout=timeout, write_timeout=timeout)
        except serial.SerialException as exc:
            raise stepbus.errors.RunError(f"{exc}; is the motor on?") from exc
        self.line.reset_input_buffer()
        # The first request has number 0: the motor goes home.
        self.number = 0
        self.state = self._exchange(0.0)

    def _exchange(self, torque: float) -> JointState:
        """Send a torque [N·m], and return what the motor answers."""
        try:
            self.line.write(request(self.number, torque))
            frame = self.line.read(REPLY_BYTES)
        except serial.SerialException as exc:
            raise stepbus.errors.RunError(f"{self.line.port}: {exc}") from exc
        if len(frame) < REPLY_BYTES:
            raise stepbus.errors.RunError(
                f"{self.line.port}: {len(frame)} of {REPLY_BYTES} bytes within "
                f"{self.line.timeout} s; is the motor on?"
            )
        number, position, velocity = read_reply(frame)
        if number != self.number:
            raise stepbus.errors.RunError(
                f"{self.line.port}: answers {number}, asked was {self.number}"
            )
        self.number = number % 255 + 1
        return JointState(position=[position], velocity=[velocity])

    def describe(self) -> Mapping[str, Description]:
        """Return the name of the joint."""
        return {"joint_state": Description(names=["wheel"])}

    def output(self, step: Step) -> Mapping[str, JointState]:
        """Return what the motor has measured."""
        return {"joint_state": self.state}

    def update(self, step: Step) -> None:
        """Send the torque of this step, and take what the motor measures then."""
        command = step.get("command", JointCommand)
        self.state = self._exchange(0.0 if command is None else command.values[0])

    def close(self) -> None:
        """Run the motor down to a stop."""
        # The torque of the last step must not outlive the run.
        if self.line.is_open:
            self.line.write(request(self.number, 0.0))
            self.line.close()
