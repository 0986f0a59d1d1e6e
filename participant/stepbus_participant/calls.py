"""Methods of a participant that users can call between two steps."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from stepbus_schemas import CallDescription, StepbusError, suggest

from .config import Config
from .parameters.problems import SettingsError
from .parameters.settings import Settings


class CallError(StepbusError, ValueError):
    """A call failed; it changed nothing."""


@dataclass(frozen=True)
class Method:
    """One method of a participant that `stepbus call` can call.

    function: takes the arguments as given (numbers, strings, lists, maps) and returns any
    MessagePack value. On failure it must raise CallError before it changes anything. help:
    arguments and answer in one line. changes: whether a later step may depend on it.
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
    """The methods `get` and `set` of a participant, for some of its parameters.

    settings: the class that declares its parameters. keys: those that may change, with their
    units. apply: receives all parameters, including the change; must raise SettingsError for
    invalid values before it changes anything. A rejected call changes nothing.
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
        """Return both methods, or none if no parameter may change."""
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
        """Restore the parameters from `save` without applying them; return them as settings."""
        self._params = dict(params)
        return dataclasses.replace(self._config, params=self._params).read(self._settings)

    def get(self, key: str | None = None) -> Any:
        """Return a parameter as given, None if it is not set; without a key, return all."""
        if key is None:
            return {name: self._params.get(name) for name in self._keys}
        self._check(key)
        return self._params.get(key)

    def set(self, key: str, value: Any) -> Any:
        """Set a parameter; return its previous value. Raises CallError that lists every problem."""
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
