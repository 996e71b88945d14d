"""``better real judge``: judge the films of a protocol without knowing condition and policy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, say
from betterbench.cli.person import person_named


def judge_command(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    person: str | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> None:
    """Judge the films of a protocol in the browser: one key for each behavior, with its definition on the screen.

    The page shows the films of the trials that are done, in an order of each person's own, and the instruction. It
    names neither condition nor policy nor what the operator or another judge entered. The same command resumes. The
    operator of a protocol cannot be a judge of it. Two judges make an agreement: see better real report.

    The command listens on this machine only: from elsewhere, forward the port (ssh -L 8080:127.0.0.1:8080 MACHINE).
    The printed address contains a token that every request needs.

    Example: better real judge bench --person ada

    Args:
        folder: Folder of the protocol.
        person: Name of the judge in the entries; the user's name if not given.
        host: Interface of the page; on 0.0.0.0 the token of the address is sent unencrypted.
        port: Port of the page; 0 for any free one.
    """
    from betterbench.cli.verbs.serve import stopped_by_signal
    from betterbench.real.judge_page import JudgePage
    from betterbench.real.judging import JudgeDesk

    desk = JudgeDesk(folder, person_named(person, "--person"))
    page = JudgePage(desk, host=host, port=port)
    try:
        if not page.server.is_local:
            say(f"On {host} the token of the page is sent unencrypted; forward the port by ssh instead.")
        with stopped_by_signal() as stopped:
            OUT.print(f"open {page.server.url}", markup=False, soft_wrap=True)
            stopped.wait()
    finally:
        page.server.close()
    say(f"stopped; {desk.done} of {len(desk.trials)} films are judged by {desk.person}", whole=True)
