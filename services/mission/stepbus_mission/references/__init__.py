"""References over time: a generator, its trajectory, and the participant that publishes it."""
