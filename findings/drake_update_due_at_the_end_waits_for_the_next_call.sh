#!/usr/bin/env bash
# Drake: AdvanceTo(t) leaves an update that is due at t for the next call, except at the start; the state seen at t is the one before.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1
cat > "$folder/try.py" <<'PYTHON'
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem


class Counter(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.25, 0.0, self.count)

    def count(self, context, state):
        state[0] = context.get_discrete_state_vector()[0] + 1


simulator = Simulator(Counter())
simulator.Initialize()
for time in (0.0, 0.25, 0.5, 0.6):
    simulator.AdvanceTo(time)
    print(f"{time:.2f} {simulator.get_context().get_discrete_state_vector()[0]:.0f}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "Drake 1.51.1: a counter with a period of 0.25 s from 0 on, looked at after each AdvanceTo"
echo "guess: 1 2 3 at 0, 0.25 and 0.5"
echo "seen:  1 1 2: at 0.25 the second update is still to come"
printf '0.00 1\n0.25 1\n0.50 2\n0.60 3\n' | cmp - "$folder/seen"
