"""The command line ``better``.

- ``main``: the table of verbs, and what every verb has in common.
- ``verbs``: one file per verb; the one that is given is imported.
- ``output``: the tables and lines that verbs print.
- ``console``, ``progress``, ``tally``, ``help_text``, ``border``: the terminal, and errors at the border.
"""

import atexit
import signal
import sys
from types import FrameType

EXIT_INTERRUPTED = 130
"""Exit status after Ctrl-C, that of a program which ended by it."""

_interrupts: list[int] = []


def was_interrupted() -> bool:
    """Tell whether Ctrl-C was pressed: what waits in native code may make another error of it."""
    return bool(_interrupts)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _interrupts.append(number)
    signal.default_int_handler(number, frame)


def _too_late(number: int, _frame: FrameType | None) -> None:
    """Let the first Ctrl-C after the work is done pass, and the next end a process that hangs."""
    signal.signal(number, signal.SIG_DFL)


def _ignore_too_late() -> None:
    # Python takes its handlers away before it takes modules down; that a signal is ignored stays.
    if signal.getsignal(signal.SIGINT) is _too_late:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def main() -> None:
    """Entry point of the command ``better``."""
    if sys.argv[1:] == ["--version"]:
        from betterbench.version import __version__

        sys.stdout.write(f"betterbench {__version__}\n")
        return
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # and not ignored, as in the background
            signal.signal(signal.SIGINT, _interrupt)
            atexit.register(_ignore_too_late)  # what is registered first is called last
        from betterbench.cli.main import main as run  # imports tyro, which --version does not need

        status = run()
        if was_interrupted():  # nothing more is to be said, whatever comes while the process ends
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        elif signal.getsignal(signal.SIGINT) is _interrupt:
            signal.signal(signal.SIGINT, _too_late)
    except BaseException as error:  # while modules are imported; from then on run() says how to go on
        if not isinstance(error, KeyboardInterrupt) and not was_interrupted():
            raise  # Python makes a RuntimeError of a KeyboardInterrupt in __set_name__
        sys.stderr.write("interrupted\n")
        status = EXIT_INTERRUPTED
    # Python remembers a KeyboardInterrupt that left exec("..."), as of a dataclass, though it was caught further out,
    # and `python -m` then ends by SIGINT in place of the status. The next exec() of a text makes it forget.
    exec("")  # noqa: S102
    sys.exit(status)
