"""What a participant offers to be called between two steps."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from stepbus_schemas import CallDescription, StepbusError, suggest

from .config import Config
from .parameters.problems import SettingsError
from .parameters.settings import Settings


class CallError(StepbusError, ValueError):
    """A call cannot be answered; nothing was done."""


@dataclass(frozen=True)
class Method:
    """One method of a participant that `stepbus call` can call.

    function: takes the arguments as given (numbers, strings, lists, maps) and returns anything
    MessagePack has; raises CallError, before it changes anything, when it cannot. help: arguments
    and answer in one line. changes: whether a later step may depend on it.
    """

    function: Callable[..., Any]
    help: str
    changes: bool = False

    @property
    def description(self) -> CallDescription:
        """Return what `Ready` publishes about it."""
        return CallDescription(help=self.help, changes=self.changes)


_S = TypeVar("_S", bound=Settings)


class Steering(Generic[_S]):
    """The calls `get` and `set` of a participant, for some of its parameters.

    settings: the class that declares its parameters. keys: those that may change, with their units.
    apply: takes all parameters, with the change; raises SettingsError, before it changes anything,
    for what does not fit. A call that is refused changes nothing.
    """

    def __init__(
        self,
        config: Config,
        settings: type[_S],
        keys: Mapping[str, str],
        apply: Callable[[_S], None],
    ) -> None:
        self._config = config
        self._settings = settings
        self._keys = keys
        self._apply = apply
        self._params = dict(config.params)

    def methods(self) -> Mapping[str, Method]:
        """Return both calls; none where nothing may change."""
        if not self._keys:
            return {}
        listed = ", ".join(f"{key} [{unit}]" if unit else key for key, unit in self._keys.items())
        return {
            "get": Method(
                self.get, f"[KEY]: returns one parameter, or all that can be set: {listed}"
            ),
            "set": Method(
                self.set,
                f"KEY VALUE: sets a parameter from this step on, one of {listed}; takes a number "
                "for all joints, a list, or a map by joint; returns the previous value",
                changes=True,
            ),
        }

    def save(self) -> dict[str, Any]:
        """Return the parameters, for a checkpoint."""
        return dict(self._params)

    def restore(self, params: Mapping[str, Any]) -> _S:
        """Take parameters that `save` returned, without applying them; return them as settings."""
        self._params = dict(params)
        return dataclasses.replace(self._config, params=self._params).read(self._settings)

    def get(self, key: str | None = None) -> Any:
        """Return a parameter as it was given, None where it was not; without a key, all."""
        if key is None:
            return {name: self._params.get(name) for name in self._keys}
        self._check(key)
        return self._params.get(key)

    def set(self, key: str, value: Any) -> Any:
        """Set a parameter; returns what it was. Raises CallError with all that is wrong."""
        self._check(key)
        params = {**self._params, key: value}
        try:
            self._apply(dataclasses.replace(self._config, params=params).read(self._settings))
        except SettingsError as exc:
            raise CallError(str(exc)) from exc
        before, self._params = self._params.get(key), params
        return before

    def _check(self, key: str) -> None:
        if key not in self._keys:
            known: Sequence[str] = list(self._keys)
            raise CallError(f"{key!r} cannot be set{suggest(str(key), known)}")
