"""The end of a bridge by a fault: a bridge of which one thread has ended works by half, so it must end as a whole."""

from __future__ import annotations

import contextlib
import threading
import traceback
from collections.abc import Callable, Iterator
from functools import wraps
from typing import ParamSpec

_Given = ParamSpec("_Given")


class Failure:
    """Keeps the first fault of a bridge's threads. Any thread.

    :ivar why: a sentence; empty: there was no fault.
    """

    def __init__(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """``is_over``: has ROS ended? Then any call of it may raise, and that is not a fault."""
        self.why = ""
        self._is_over = is_over
        self._lock = threading.Lock()

    def thread(self, name: str, run: Callable[[], None]) -> threading.Thread:
        """Make a thread that is not started yet. An exception that ends it is a fault of the bridge."""

        def guarded() -> None:
            with contextlib.suppress(Exception), self._noted(f"its thread `{name}`"):
                run()

        return threading.Thread(target=guarded, name=name, daemon=True)

    def handler(self, function: Callable[_Given, None]) -> Callable[_Given, None]:
        """Wrap a function that another thread calls, which continues when it raises. For the bridge that is a
        fault: what the function did not finish stays undone."""

        @wraps(function)
        def guarded(*given: _Given.args, **named: _Given.kwargs) -> None:
            with self._noted(f"its handler `{function.__name__.lstrip('_')}`"):
                function(*given, **named)

        return guarded

    def note_thread(self, fault: threading.ExceptHookArgs) -> None:
        """Replace ``threading.excepthook``, for threads that others made."""
        if fault.exc_value is not None and not isinstance(fault.exc_value, SystemExit):
            self.note(f"its thread `{'' if fault.thread is None else fault.thread.name}`", fault.exc_value)

    def note(self, what: str, error: BaseException) -> None:
        """Keep a fault of this process. ``what``: the part that failed, as the subject of the sentence."""
        if self._is_over():
            return
        with self._lock:
            self.why = self.why or f"{what} failed: {type(error).__name__}: {error}"
        # Only then: if standard error is a file on a full disk, this raises.
        with contextlib.suppress(OSError, ValueError):
            traceback.print_exception(error)

    @contextlib.contextmanager
    def _noted(self, what: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            self.note(what, error)
            raise
