"""What tests of your own participants need: no processes, no bus, no orchestrator.

```python
from stepbus import JointCommand, JointState
from stepbus.testing import Bench, make_config

def test_it_pushes_back():
    config = make_config(inputs={"joint_state": JointState}, outputs={"command": JointCommand})
    bench = Bench(MyController, config)
    command = bench.step(joint_state=JointState(position=[0.1]))["command"]
    assert command.values[0] < 0
```
"""

from stepbus_participant import LoopbackBus

from .bench import Bench, assert_replays, feed
from .configs import make_config, scenario_config

__all__ = [
    "Bench",
    "LoopbackBus",
    "assert_replays",
    "feed",
    "make_config",
    "scenario_config",
]
