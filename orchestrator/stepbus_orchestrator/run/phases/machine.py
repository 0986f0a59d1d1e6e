"""The state machine of a run: start-up, stepping, closing, shutdown, and the fallback."""

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.loop.loop import RunLoop

from .closing import close
from .fallback import after_fallback, failed_in_fallback, fall_back
from .shutdown import check_ends, shut_down
from .start_up import start_up
from .stepping import step


def run_phases(loop: RunLoop) -> str:
    """Go through the phases of a run and return why it ended.

    Every process is ended, whatever happens. Raises RunFailure when the run ends before its time,
    or a participant does not end as it should.
    """
    return _Machine(loop).run()


_ACTS = {RunPhase.START_UP: start_up, RunPhase.STEPPING: step, RunPhase.CLOSING: close}


class _Machine:
    """The phases in their order; which may follow which is in `kernel.phase`.

    failure: what ends the run before its time.
    """

    def __init__(self, loop: RunLoop) -> None:
        self._loop = loop
        self._failure: RunFailure | None = None

    def run(self) -> str:
        loop = self._loop
        try:
            self._run_until_shutdown()
        except BaseException:
            loop.stop("the orchestrator ends")
            raise
        finally:
            loop.state.enter(RunPhase.SHUTDOWN)
            late = shut_down(loop, self._failure)
        if self._failure is not None:
            raise self._failure
        check_ends(loop, late)
        return loop.state.reason

    def _run_until_shutdown(self) -> None:
        phase = self._run_phase(RunPhase.START_UP)
        while phase is not RunPhase.SHUTDOWN:
            self._loop.state.enter(phase)
            phase = self._run_phase(phase)
        if self._failure is not None:
            self._loop.stop(str(self._failure))

    def _run_phase(self, phase: RunPhase) -> RunPhase:
        """Run one phase and return the one after it."""
        try:
            following = self._act(phase)
        except RunFailure as failure:
            return self._after(failure)
        if phase is RunPhase.CLOSING and self._failure is not None:
            self._failure = after_fallback(self._failure, self._loop)
        return following

    def _act(self, phase: RunPhase) -> RunPhase:
        if self._failure is not None and phase is RunPhase.FALLBACK:
            return fall_back(self._loop, self._failure)
        return _ACTS[phase](self._loop)

    def _after(self, failure: RunFailure) -> RunPhase:
        """Return the phase that follows a failure."""
        if self._loop.safe_stop.can_handle(failure):
            self._failure = failure
            return RunPhase.FALLBACK
        if self._failure is not None:
            failure = failed_in_fallback(self._failure, failure)
        self._failure = failure
        return RunPhase.SHUTDOWN
