"""The curves of joint control: error, position, velocity and torque, all joints in each."""

from collections.abc import Iterator, Sequence

from stepbus_tools.report.curves.curve import Line
from stepbus_tools.report.curves.tracking import TrackingCurves
from stepbus_tools.report.signals_plot import MOST_LINES, Panel


def joint_panels(tracking: TrackingCurves) -> list[Panel]:
    """Return a panel for each quantity that there is; joints that slide have panels of their own.

    Measured values are drawn over references, torques over commands. Of more than twenty joints,
    the first are shown.
    """
    panels: list[Panel] = []
    for is_sliding, length, force in (
        (False, "rad", ("torque", "N·m")),
        (True, "m", ("force", "N")),
    ):
        joints = [name for name in tracking.measured if tracking.is_prismatic(name) == is_sliding]
        more = f" (first {MOST_LINES} of {len(joints)} joints)" if len(joints) > MOST_LINES else ""
        shown = joints[:MOST_LINES]
        panels += [
            _errors(tracking, shown, length, more),
            _motion(tracking, shown, "position", length, more),
            _motion(tracking, shown, "velocity", f"{length}/s", more),
            _efforts(tracking, shown, *force, more),
        ]
    return [panel for panel in panels if panel.lines]


def _errors(tracking: TrackingCurves, joints: Sequence[str], unit: str, more: str) -> Panel:
    """Return reference minus measured position; without a reference, the targets of the motors."""
    what = "reference" if tracking.joints else "target"
    known = tracking.joints or (tracking.measured if tracking.has_targets else ())
    lines = {joint: tracking.error(joint) for joint in joints if joint in known}
    return Panel(title=f"error: {what} − measured{more}", unit=unit, lines=lines)


def _motion(
    tracking: TrackingCurves, joints: Sequence[str], quantity: str, unit: str, more: str
) -> Panel:
    """Return measured positions, or velocities, over the reference."""
    panel = Panel(title=f"{quantity}{more}", unit=unit)
    for joint in joints:
        state, reference = tracking.state_of(joint), tracking.reference_of(joint)
        measured = None if state is None else state.of(quantity, joint)
        if measured is None and state is not None and quantity == "velocity":
            # Where it is not sensed, it is the finite difference of positions.
            measured = state.slope(joint)
        wanted = None if reference is None else reference.of(quantity, joint)
        _put(panel, joint, measured, wanted, "reference")
    return panel


def _efforts(
    tracking: TrackingCurves, joints: Sequence[str], what: str, unit: str, more: str
) -> Panel:
    """Return measured efforts over the commands; where none is measured, the commands."""
    panel = Panel(title=f"{what}{more}", unit=unit)
    for joint in joints:
        state = tracking.state_of(joint)
        measured = None if state is None else state.of("effort", joint)
        commanded = next(_commands(tracking, joint), None)
        if measured is None:
            measured, commanded = commanded, None
        _put(panel, joint, measured, commanded, "commanded")
    return panel


def _commands(tracking: TrackingCurves, joint: str) -> Iterator[Line]:
    for port in tracking.torques:
        if (line := port.of("values", joint)) is not None:
            yield line


def _put(panel: Panel, joint: str, measured: Line | None, wanted: Line | None, name: str) -> None:
    """Add the lines of a joint; the legend names what is dashed once."""
    if measured is not None:
        panel.lines[joint] = measured
    if wanted is not None:
        panel.dashed[f"_{joint}" if panel.dashed else name] = wanted
