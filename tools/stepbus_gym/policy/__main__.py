"""Take part in a run as a policy: `python -m stepbus_gym.policy module:function`."""

import sys

from stepbus_gym.policy import LoadedPolicy
from stepbus_participant import main

if __name__ == "__main__":
    raise SystemExit(main(lambda config: LoadedPolicy(config, "".join(sys.argv[1:2]))))
