"""The controller of by_the_page.py, written to the page of protocol 1: `page_before.py NUMBER`."""

import sys

import by_the_page


class Controller(by_the_page.Controller):
    """Reads `upto` in a trigger, where step_limit is; announces the number it is given."""

    def hello(self):
        return {**super().hello(), "protocol": int(sys.argv[1])}

    def take_control(self, key, data):
        message = by_the_page.unpack(data)
        if key == "trigger" and "upto" not in message:
            self.unauthenticated += 1
        else:
            super().take_control(key, data)


if __name__ == "__main__":
    sys.exit(by_the_page.main(Controller))
