"""Warning that is logged if the first trials of a run all end with the same error."""

from __future__ import annotations

import logging
import re

from betterbench.records import JournalEntry

logger = logging.getLogger(__name__)

FIRST_TRIALS = 5
"""Number of trials that must end with the same error. Fewer trials could have the same error by chance."""


class FailingStart:
    """Monitor that logs one warning if the first trials of a run all end with the same error.

    The run continues, because a policy may really fail in every trial.
    """

    def __init__(self, policy: str) -> None:
        """Create the monitor. ``policy`` is the policy address, for the message."""
        self._policy = policy
        self._reason: str | None = None
        self._alike = 0
        self._over = False

    def add(self, entry: JournalEntry) -> None:
        """Take the journal entry of a finished trial into account."""
        if self._over:
            return
        # Numbers in the message are ignored, since they may depend on the trial or on the step.
        reason = None if entry.message is None else re.sub(r"\d+", "#", entry.message)
        if reason is None or self._reason not in (None, reason):
            self._over = True
            return
        self._reason, self._alike = reason, self._alike + 1
        if self._alike == FIRST_TRIALS:
            self._over = True
            logger.warning(
                "the first %d trials all ended with the same error (%s). The run continues; stop it with Ctrl-C and "
                "try better doctor --policy '%s'.",
                FIRST_TRIALS,
                entry.message,
                self._policy,
            )
