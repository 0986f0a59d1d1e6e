"""How well joints followed their reference."""

from stepbus_orchestrator.analysis.tracking import TrackingError


def tracking_rmse(tracking, after_s=2.0):
    """Return the root mean square of each joint's tracking error in one piece [rad or m]."""
    error = TrackingError(after_s)
    error.take(tracking)
    return error.rmse()
