"""Deadlines for runs in which nobody is meant to miss one."""

from stepbus_orchestrator.scenario.load import load


def patient(scenario, *overrides):
    """Return overrides for a scenario, with time for its participants on a machine of any speed."""
    kinds = ("spawn", "step", "stop")
    names = [spec.name for spec in load(scenario, list(overrides)).participants]
    return [*(f"{name}.{kind}_timeout=120s" for name in names for kind in kinds), *overrides]
