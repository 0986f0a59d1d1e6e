"""A policy: PD control of two_link, from the observation of its environment."""


def act(observation):
    position, velocity = observation[0:2], observation[2:4]
    wanted, rate = observation[6:8], observation[8:10]
    return 200 * (wanted - position) + 30 * (rate - velocity)


def other(observation):
    return act(observation) + 1e-9
