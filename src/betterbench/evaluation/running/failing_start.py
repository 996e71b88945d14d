"""An alarm for the evening: a run whose first trials all broke in the same way will hardly do better later."""

from __future__ import annotations

import logging
import re

from betterbench.recording import JournalEntry

logger = logging.getLogger(__name__)

FIRST_TRIALS = 5
"""How many trials have to end alike before anybody is called. A policy that breaks by chance does not do that."""


class FailingStart:
    """Listens to a run from its beginning and warns once, if none of the first trials ended but by the same error.

    The run goes on: that every trial ends as ``policy_error`` may be the truth about a policy.
    """

    def __init__(self, policy: str) -> None:
        """Begin to listen.

        Args:
            policy: Address of the policy.
        """
        self._policy = policy
        self._reason: str | None = None
        self._alike = 0
        self._over = False

    def hear(self, entry: JournalEntry) -> None:
        """Take note of a trial that has ended.

        Args:
            entry: Its line for the journal.
        """
        if self._over:
            return
        # Numbers in a reason tell the trial or the step.
        reason = None if entry.message is None else re.sub(r"\d+", "#", entry.message)
        if reason is None or self._reason not in (None, reason):
            self._over = True
            return
        self._reason, self._alike = reason, self._alike + 1
        if self._alike == FIRST_TRIALS:
            self._over = True
            logger.warning(
                "the first %d trials all ended with the same error (%s). The run goes on; stop it with Ctrl-C and try "
                "better doctor --policy '%s'.",
                FIRST_TRIALS,
                entry.message,
                self._policy,
            )
