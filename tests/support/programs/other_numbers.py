"""The controller of by_the_page.py with other protocol numbers: `other_numbers.py LOWEST HIGHEST`."""

import sys

import by_the_page


class Controller(by_the_page.Controller):
    """Names other protocol numbers in its `Hello`."""

    lowest, highest = int(sys.argv[1]), int(sys.argv[2])


if __name__ == "__main__":
    print("speaks", sys.argv[1:], file=sys.stderr)
    sys.exit(by_the_page.main(Controller))
