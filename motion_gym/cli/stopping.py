"""Ctrl-C and SIGTERM: both end a command by one exception, wherever the signal meets it."""

import signal
import sys
import threading
from types import FrameType


class Stopped(KeyboardInterrupt):
    """The signal ``number`` came.

    A class of its own: where ``KeyboardInterrupt`` itself has passed code that ``exec`` compiled, Python ends by
    SIGINT, whatever the status of its exit (bpo-1054041).
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def stop_on_signals() -> None:
    """Raise `Stopped` at SIGINT and SIGTERM, except for one that this process was started to ignore."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _stop)
    sys.unraisablehook = _stop_again


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


def _stop_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Send the signal again if Python could not raise it: in a callback of a compiler, in ``__del__``."""
    if isinstance(unraisable.exc_value, Stopped):
        # To the main thread itself, which may be waiting.
        main = threading.main_thread().ident
        again = threading.Timer(0.05, signal.pthread_kill, (main, unraisable.exc_value.number))
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(unraisable)
