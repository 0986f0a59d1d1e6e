"""The controller of by_the_page.py, with the names of protocol 1 and the number 2."""

import sys

import by_the_page


class Controller(by_the_page.Controller):
    """Reads `upto` in a trigger, where step_limit is."""

    def take_control(self, key, data):
        message = by_the_page.unpack(data)
        if key == "trigger" and "upto" not in message:
            self.unauthenticated += 1
        else:
            super().take_control(key, data)


if __name__ == "__main__":
    sys.exit(by_the_page.main(Controller))
