"""A participant that publishes which steps of its sources it has read; see test_multirate.py."""

import stepbus


class Echo(stepbus.Participant):
    """Publishes the step and, for each input, the step of the message that it holds; -1: none.

    params: `silent`: it publishes nothing at its firings n with n % silent == 1.
    """

    read: tuple[int, ...] = ()

    def output(self, step):
        return self._message(step) if self.config.publishes == "first" else {}

    def update(self, step):
        held = [step.get(name) for name in sorted(self.config.inputs)]
        self.read = tuple(-1 if message is None else message.step for message in held)
        return None if self.config.publishes == "first" else self._message(step)

    def _message(self, step):
        silent = self.config.params["silent"]
        if silent and step.index // self.config.every % silent == 1:
            return {}
        read = self.read or (-1,) * len(self.config.inputs)
        return {"out": self.config.types["Echo/1"](step=step.index, read=read)}
