"""Take part in a run as the round trip of an arm."""

from stepbus_participant import main

from .participant import RoundTrip

if __name__ == "__main__":
    raise SystemExit(main(RoundTrip))
