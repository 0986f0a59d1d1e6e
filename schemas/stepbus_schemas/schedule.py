"""Which message an input takes at a step (docs/protocol.md, P6.1)."""


def due_step(step: int, delay: int = 0, every: int = 1) -> int:
    """Return the step whose message an input takes at `step`; negative: none is due yet.

    delay: least age of the message [steps]. every: its source fires at multiples of this [steps].
    """
    reach = step - delay
    return reach - reach % every if reach >= 0 else -1
