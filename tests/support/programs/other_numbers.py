"""The controller of by_the_page.py with other protocol numbers: `other_numbers.py LOWEST HIGHEST`.

It writes and reads what the page of the number has that the `Welcome` names. With a step as a third
argument, it reports a fault there.
"""

import sys

import by_the_page


class Controller(by_the_page.Controller):
    """Uses the names of protocol 1 where that is the number of the run."""

    lowest, highest = int(sys.argv[1]), int(sys.argv[2])
    fault_step = int(sys.argv[3]) if len(sys.argv) > 3 else None

    def take_control(self, key, data):
        message = by_the_page.unpack(data)
        if key == "trigger" and self.welcome["protocol"] == 1:
            data = by_the_page.msgpack.packb(
                {"token": message["token"], "step_limit": message["upto"]}
            )
        super().take_control(key, data)

    def command(self):
        if self.step == self.fault_step:
            raise by_the_page.Fault("too hot")
        return super().command()

    def report(self, exc):
        if self.welcome["protocol"] == 1:
            put = self.puts["fault"]
            self.puts["fault"] = lambda it: put(
                {"kind" if k == "type" else k: v for k, v in it.items()}
            )
        return super().report(exc)


if __name__ == "__main__":
    print("speaks", sys.argv[1:], file=sys.stderr)
    sys.exit(by_the_page.main(Controller))
