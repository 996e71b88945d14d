"""``better real judge``: judge the videos of a protocol without knowing condition and policy."""

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
    """Judge the videos of a protocol in the browser, with one key for each behavior.

    The page shows the videos of finished trials in a random order, with the instruction and the definitions of the
    behaviors. It does not show the condition, the policy, or the entries of other people. Running the command again
    continues where you stopped. The operator of a protocol cannot judge it. With two judges, `better real report`
    computes their agreement.

    By default, the page can only be opened on this machine. To open it on another machine, forward the port (ssh -L
    8080:127.0.0.1:8080 MACHINE). The printed address contains the access token of the page.

    Example: better real judge bench --person ada

    Args:
        folder: Folder of the protocol.
        person: Name of the judge; default: the user name.
        host: Network interface to listen on. With 0.0.0.0, other machines can open the page, but its access token is
            sent unencrypted.
        port: Port to listen on; 0 for any free port.
    """
    from betterbench.cli.verbs.serve import stopped_by_signal
    from betterbench.real.judge_page import JudgePage
    from betterbench.real.judging import JudgeDesk

    desk = JudgeDesk(folder, person_named(person, "--person"))
    page = JudgePage(desk, host=host, port=port)
    try:
        if not page.server.is_local:
            say(f"On {host}, the page's token is sent unencrypted. Use SSH port forwarding instead.")
        with stopped_by_signal() as stopped:
            OUT.print(f"open {page.server.url}", markup=False, soft_wrap=True)
            stopped.wait()
    finally:
        page.server.close()
    say(f"stopped; {desk.person} has judged {desk.done} of {len(desk.trials)} videos", whole=True)
