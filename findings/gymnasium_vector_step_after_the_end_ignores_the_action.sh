#!/usr/bin/env bash
# Gymnasium: in a vector of environments, the step after the end of an episode is its reset: the action is ignored and the reward 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gymnasium==1.4.0
cat > "$folder/try.py" <<'PYTHON'
import gymnasium
import numpy as np


class Counter(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-9, 9, (1,))
    action_space = gymnasium.spaces.Box(-9, 9, (1,))

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.count = np.zeros(1, np.float32)
        return self.count, {}

    def step(self, action):
        self.count = self.count + action
        return self.count, 1.0, bool(self.count[0] >= 2), False, {}


environments = gymnasium.vector.SyncVectorEnv([Counter])
environments.reset(seed=0)
for _ in range(5):
    count, reward, ended, *_ = environments.step(np.ones((1, 1), np.float32))
    print(int(count[0, 0]), int(reward[0]), bool(ended[0]))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "Gymnasium 1.4.0: SyncVectorEnv of one counter that ends at 2, five steps with the action 1: count, reward, ended"
echo "guess: after the end the new episode starts with the next action: 1 1 False"
echo "seen:  0 0 False: one step more an episode than actions that count"
printf '1 1 False\n2 1 True\n0 0 False\n1 1 False\n2 1 True\n' | cmp - "$folder/seen"
