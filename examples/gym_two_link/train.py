"""Train a policy of two_link with CMA-ES: a minute on one core.

    python examples/gym_two_link/train.py [--generations 25]

Writes gains.json and curve.png beside itself, and an episode of the trained policy to episodes/.
"""

import argparse
import json
from pathlib import Path

import cma
import numpy as np
from gymnasium import make
from policy import GAINS, torque

import stepbus_gym  # noqa: F401  (registers the environment)

POPULATION = 8
CURVE = Path(__file__).with_name("curve.png")


def episode(env, numbers):
    """Return the sum of the rewards of one episode."""
    observation, _ = env.reset(seed=0)
    total, over = 0.0, False
    while not over:
        action = torque(numbers, observation)
        observation, reward, terminated, truncated, _ = env.step(action)
        total += reward
        over = terminated or truncated
    # What it has not reached is as bad as the limit at which it was ended.
    return total - 4.0 * (400 - env.unwrapped.result.steps)


def train(generations):
    """Return the best numbers, and the returns of all policies of each generation."""
    env = make("stepbus/two_link-v0", duration="2s")
    search = cma.CMAEvolutionStrategy(
        np.full(7, 0.3), 0.3, {"popsize": POPULATION, "seed": 1, "verbose": -9}
    )
    history = []
    for generation in range(generations):
        candidates = search.ask()
        returns = [episode(env, numbers) for numbers in candidates]
        search.tell(candidates, [-value for value in returns])
        history.append(returns)
        print(
            f"generation {generation:3}: best {max(returns):10.3f}, median {np.median(returns):.3f}"
        )
    env.close()
    return search.result.xbest, np.array(history)


def plot(history):
    """Draw the learning curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    cost = -history
    episodes = POPULATION * np.arange(1, len(history) + 1)
    axes.fill_between(
        episodes, cost.min(axis=1), cost.max(axis=1), alpha=0.25, label="all of a generation"
    )
    axes.plot(episodes, np.median(cost, axis=1), label="its median")
    axes.plot(episodes, np.minimum.accumulate(cost.min(axis=1)), "k--", label="best so far")
    axes.set(
        yscale="log",
        xlabel="episodes of 2 s",
        ylabel="cost: minus the sum of rewards",
        title="stepbus/two_link-v0, CMA-ES with 7 numbers",
    )
    axes.grid(which="major", alpha=0.4)
    axes.legend()
    figure.savefig(CURVE, dpi=110)


def main():
    """Train, and record what came of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--generations", type=int, default=25)
    best, history = train(parser.parse_args().generations)
    GAINS.write_text(json.dumps([round(float(value), 6) for value in best]) + "\n")
    plot(history)
    env = make("stepbus/two_link-v0", duration="2s", record="all")
    print("trained:", round(episode(env, np.array(json.loads(GAINS.read_text()))), 3))
    print("episode:", env.unwrapped.result.recording)
    env.close()


if __name__ == "__main__":
    main()
