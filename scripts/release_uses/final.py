"""A metric of a sweep: where the joint is at the end."""

import stepbus


def final(recording: stepbus.Recording) -> float:
    """Return the last position [m]."""
    *_, last = recording.port("cart/joint_state").messages()
    return last.position[0]
