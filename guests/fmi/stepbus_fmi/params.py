"""Parameters of an FMU as a participant."""

from typing import Any

from stepbus_participant import File, Finite, Positive, Settings, Text


class Link(Settings, omit_defaults=True):
    """Where an input variable gets its value."""

    short = "from"

    from_: Text
    """Input port and what of its message: `PORT.NAME` for one of the names of the port, such as
    `in.speed`; `PORT.FIELD`, `PORT.FIELD[2]` or `PORT.FIELD[NAME]` for a field."""
    factor: Finite = 1.0
    """What the value is multiplied by, before its unit is converted."""
    offset: Finite = 0.0
    """What is then added to it."""
    convert: bool = True
    """Whether the value is converted to the unit of the variable; false: units are not compared."""


class Params(Settings):
    """Parameters of `stepbus_fmi:Fmu`; `participant: model.fmu` sets the first."""

    fmu: File
    """The FMU, or the archive that has it."""
    inside: str = ""
    """Where the FMU is in that archive, such as `resources/motor.fmu` of an SSP."""
    start: dict[str, Any] = {}
    """Variable → start value: a number, `"3 kg"` with a unit, a boolean, a text, the name of an
    enumeration's item; for an array, a list."""
    inputs: dict[str, Link] = {}
    """Input variable → where its value comes from. Default: the input port that has its name; a
    variable `command.values[1]` is the first value of the field `values` of the port `command`."""
    by_name: bool = True
    """Whether inputs that `inputs` does not name are connected by name; false: they keep their
    start values."""
    outputs: dict[str, dict[str, Any]] = {}
    """Output port → field of its message → variable, list of variables, or a constant. Default:
    the output variables of the port's type."""
    publish: tuple[Text, ...] = ()
    """Further variables, such as local ones, that are published beside the output variables."""
    start_time: Finite = 0.0
    """Time of the FMU at step 0 [s]."""
    tolerance: Positive | None = None
    """Relative tolerance of the FMU's solver. Default: its own."""
    event_mode: bool = True
    """Whether an FMU for FMI 3.0 that has an event mode uses it."""
    extrapolate: tuple[Text, ...] = ()
    """Input variables that continue with the slope of their last two values within a step, if the
    FMU is for FMI 2.0 and can interpolate inputs. All others are held."""
    log: bool = False
    """Whether the FMU logs all that it can, to `logs/<name>.log`."""
