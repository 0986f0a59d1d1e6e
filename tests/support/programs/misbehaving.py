"""A controller for tests that misbehaves once: whoever copies it fills in KIND and MOMENT.

The moments: at its import, at its start (its class is made), at step 300, and at its close.
"""

import atexit
import concurrent.futures
import contextlib
import ctypes
import os
import signal
import subprocess
import threading
import time

import stepbus
from stepbus import Description, JointCommand, JointState, Participant

KIND, MOMENT = "", ""
STEP = 300
LONG_S = 100_000
MUTEX = ctypes.create_string_buffer(64)


def never_return(library) -> None:
    """Lock a mutex twice, in C: nothing interrupts that, no signal either."""
    library.pthread_mutex_lock(MUTEX)
    library.pthread_mutex_lock(MUTEX)


def spin() -> None:
    while True:
        pass


def sleep() -> None:
    time.sleep(LONG_S)


def sleep_with_lock() -> None:
    ctypes.PyDLL(None).sleep(LONG_S)


def hang_with_lock() -> None:
    never_return(ctypes.PyDLL(None))


def hang_in_c() -> None:
    never_return(ctypes.CDLL(None))


def catch_everything() -> None:
    while True:
        with contextlib.suppress(BaseException):
            time.sleep(LONG_S)


def ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGURG):
        signal.signal(number, signal.SIG_IGN)


def ignore_signals_and_sleep() -> None:
    ignore_signals()
    time.sleep(LONG_S)


def lock_from_thread() -> None:
    threading.Thread(target=hang_with_lock, daemon=True).start()
    time.sleep(0.5)


def lock_from_thread_later() -> None:
    threading.Timer(0.01, hang_with_lock).start()


def leave_thread() -> None:
    threading.Thread(target=sleep).start()


def leave_daemon() -> None:
    threading.Thread(target=threading.Event().wait, daemon=True).start()


def leave_pool() -> None:
    concurrent.futures.ThreadPoolExecutor().submit(sleep)


def leave_exit() -> None:
    atexit.register(sleep)


def leave_exit_with_lock() -> None:
    atexit.register(hang_with_lock)


def kill_self() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def kill_group() -> None:
    os.kill(0, signal.SIGTERM)


def raise_kill() -> None:
    signal.raise_signal(signal.SIGKILL)


def stop_self() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def stop_in_c() -> None:
    signal.raise_signal(signal.SIGSTOP)


def crash() -> None:
    ctypes.string_at(0)


def abort() -> None:
    os.abort()


def leave_process() -> None:
    os._exit(3)


def leave_process_in_c() -> None:
    ctypes.CDLL(None)._exit(3)


def fork() -> None:
    if not os.fork():
        time.sleep(LONG_S)


def fork_terminal() -> None:
    os.forkpty()


def fork_twice() -> None:
    if not os.fork():
        if not os.fork():
            time.sleep(LONG_S)
        os._exit(0)


def fork_in_c() -> None:
    ctypes.PyDLL(None).fork()


def leave_child() -> None:
    subprocess.Popen(["sh", "-c", "trap '' TERM INT HUP; while :; do sleep 1; done"])


def leave_grandchild() -> None:
    subprocess.run(["sh", "-c", "trap '' TERM INT HUP; sleep 1000 & :"], check=True)


def leave_session() -> None:
    subprocess.Popen(["sleep", "1000"], start_new_session=True)


def close_standard_streams() -> None:
    for number in (0, 1, 2):
        os.close(number)


def misbehave(moment: str) -> None:
    """Do it, if it is time."""
    if moment == MOMENT:
        globals()[KIND]()


class Controller(Participant):
    """Sends zeros."""

    def __init__(self, config: stepbus.Config) -> None:
        super().__init__(config)
        misbehave("start")

    def describe(self):
        return {"command": Description(like="joint_state")}

    def update(self, step):
        if step.index == STEP:
            misbehave("step")
        state = step.read("joint_state", JointState)
        return {"command": JointCommand(mode="torque", values=[0.0] * len(state.position))}

    def close(self) -> None:
        misbehave("close")


misbehave("import")
