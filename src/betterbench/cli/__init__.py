"""The command line."""

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


def main() -> None:
    """Entry point of the command ``better``."""
    if sys.argv[1:] == ["--version"]:
        from betterbench import __version__

        sys.stdout.write(f"betterbench {__version__}\n")
        return
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # and not ignored, as in the background
            signal.signal(signal.SIGINT, _interrupt)
        from betterbench.cli.main import main as run  # imports tyro, which --version does not need

        status = run()
        if was_interrupted():  # nothing more is to be said, whatever comes while the process ends
            signal.signal(signal.SIGINT, signal.SIG_DFL)
    except KeyboardInterrupt:  # while modules are imported; from then on run() says how to go on
        sys.stderr.write("interrupted\n")
        status = EXIT_INTERRUPTED
    # Python remembers a KeyboardInterrupt that left exec("..."), as of a dataclass, though it was caught further out,
    # and `python -m` then ends by SIGINT in place of the status. The next exec() of a text makes it forget.
    exec("")  # noqa: S102
    sys.exit(status)
