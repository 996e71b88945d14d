"""The command ``better``: arguments in, functions of the library, text out."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence

import tyro

from betterbench.cli.audit_paper import audit_paper
from betterbench.cli.calibrate import calibrate
from betterbench.cli.certify import certify
from betterbench.cli.compare import compare
from betterbench.cli.console import ERR, say
from betterbench.cli.demo import demo
from betterbench.cli.diagnose import diagnose
from betterbench.cli.doctor import doctor
from betterbench.cli.evaluate import evaluate
from betterbench.cli.listing import list_things
from betterbench.cli.replay import replay
from betterbench.cli.report import report
from betterbench.cli.serve import serve
from betterbench.cli.show import show
from betterbench.errors import BetterError

VERBS: dict[str, Callable[..., None]] = {
    "doctor": doctor,
    "list": list_things,
    "show": show,
    "certify": certify,
    "calibrate": calibrate,
    "eval": evaluate,
    "diagnose": diagnose,
    "compare": compare,
    "report": report,
    "replay": replay,
    "serve": serve,
    "demo": demo,
    "audit-paper": audit_paper,
}
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb.

    Args:
        arguments: Command line without the program's name; that of the process if not given.

    Returns:
        Exit status: 0, or 2 where the input was wrong.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    logging.basicConfig(level=logging.WARNING, format="%(message)s", stream=sys.stderr)
    try:
        tyro.extras.subcommand_cli_from_dict(
            VERBS,
            prog="better",
            description="Diagnose why a Vision-Language-Action policy fails.",
            args=list(sys.argv[1:] if arguments is None else arguments),
        )
    except BetterError as error:
        ERR.print("[bold red]error:[/] ", end="")
        say(str(error))
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        say("interrupted; run the same command again to go on where it stopped")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    return 0
