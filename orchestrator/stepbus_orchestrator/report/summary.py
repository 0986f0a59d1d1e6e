"""What the summary of a run says of its joints."""

from __future__ import annotations

from stepbus_orchestrator.analysis.signals import Tracking, tracking_rmse
from stepbus_orchestrator.analysis.sinusoid import sinusoid_lines

_SETTLED_S = 2.0
# More joints than that are named by the worst one only.
_MOST_NAMED = 6


def summary_lines(tracking: Tracking) -> list[str]:
    """Return how well the joints follow their reference, in lines; none without one."""
    state = tracking.state
    if state is None:
        return []
    settled = bool(state.t[-1] > _SETTLED_S)
    rmse = tracking_rmse(tracking, _SETTLED_S if settled else 0.0)
    if not rmse:
        return []
    when = f"after {_SETTLED_S:g} s" if settled else "of the whole run"
    lines = sinusoid_lines(tracking, _SETTLED_S if settled else 0.0)
    if len(rmse) > _MOST_NAMED:
        worst = max(rmse, key=lambda joint: rmse[joint])
        return [*lines, f"tracking RMSE {when}: at most {rmse[worst]:.3g} rad ({worst})"]
    values = ", ".join(f"{joint} {value:.3g} rad" for joint, value in rmse.items())
    return [*lines, f"tracking RMSE {when}: {values}"]
