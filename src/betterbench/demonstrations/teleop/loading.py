"""Preparation of the next teleoperation session.

The preparation takes several seconds. It can run in a thread, so that the control loop is not blocked.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from betterbench.demonstrations.making.starts import Start
from betterbench.demonstrations.teleop.session import TeleopSession


class SessionLoader:
    """Loader that prepares one session at a time.

    If ``apart`` is True, sessions are prepared in a separate thread, which is abandoned when the command ends.
    """

    def __init__(self, make: Callable[[Start], TeleopSession], *, apart: bool = False) -> None:
        self._make, self._apart = make, apart
        self._thread: threading.Thread | None = None
        self._made: TeleopSession | None = None
        self._problem: BaseException | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a session is being prepared."""
        return self._thread is not None and self._thread.is_alive()

    def begin(self, start: Start) -> None:
        """Begin to prepare the session for an initial state.

        The previous session must have been fetched with ``take``.
        """
        if not self._apart:
            self._made = self._make(start)
            return
        self._thread = threading.Thread(target=self._work, args=(start,), name="teleop loading", daemon=True)
        self._thread.start()

    def take(self) -> TeleopSession | None:
        """Return the prepared session, or None while it is not ready. If the preparation failed, raise its error."""
        if self.is_busy:
            return None
        self._thread = None
        made, problem = self._made, self._problem
        self._made = self._problem = None
        if problem is not None:
            raise problem
        return made

    def _work(self, start: Start) -> None:
        try:
            self._made = self._make(start)
        except BaseException as problem:  # noqa: BLE001 - raised again when the session is taken
            self._problem = problem
