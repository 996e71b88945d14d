"""The command line ``better``.

- ``main``: the table of all subcommands, and the options that they share.
- ``verbs``: one file per subcommand; only the chosen subcommand is imported.
- ``output``: the tables and lines that subcommands print.
- ``console``: messages. ``progress``: progress bars. ``tally``: statistics shown during a run. ``help_text``: help
  texts. ``border``: range checks of options.
"""

import atexit
import gc
import signal
import sys
from types import FrameType

EXIT_INTERRUPTED = 130
"""Exit status after Ctrl-C: the status of a process ended by SIGINT."""

_interrupts: list[int] = []


def was_interrupted() -> bool:
    """Return whether the user pressed Ctrl-C.

    Callers check this because interrupted native code may raise an error other than KeyboardInterrupt.
    """
    return bool(_interrupts)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _interrupts.append(number)
    signal.default_int_handler(number, frame)


def _too_late(number: int, _frame: FrameType | None) -> None:
    """Ignore the first Ctrl-C that arrives after the work is done.

    A second Ctrl-C ends the process, in case it hangs.
    """
    signal.signal(number, signal.SIG_DFL)


def _ignore_too_late() -> None:
    # Python removes its signal handlers before it unloads modules, whereas an ignored signal stays ignored.
    if signal.getsignal(signal.SIGINT) is _too_late:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def begin_collecting() -> None:
    """Enable garbage collection if :func:`main` has disabled it. Collections skip what has been imported before."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def main() -> None:
    """Entry point of the ``better`` command."""
    if sys.argv[1:] == ["--version"]:
        from betterbench.version import __version__

        sys.stdout.write(f"betterbench {__version__}\n")
        return
    gc.disable()  # until begin_collecting(), because collections take a tenth of the time of imports and find nothing
    try:
        # SIGINT may be ignored if this process is a background job.
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupt)
            atexit.register(_ignore_too_late)  # exit functions are called in reverse order of registration
        # imported here because tyro is slow to import and --version does not need it
        from betterbench.cli.main import main as run

        status = run()
        if was_interrupted():  # print nothing more while the process ends
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        elif signal.getsignal(signal.SIGINT) is _interrupt:
            signal.signal(signal.SIGINT, _too_late)
    except BaseException as error:  # Ctrl-C during the imports; later, run() handles Ctrl-C
        if not isinstance(error, KeyboardInterrupt) and not was_interrupted():
            raise  # Python wraps a KeyboardInterrupt in __set_name__ in a RuntimeError
        sys.stderr.write("interrupted\n")
        status = EXIT_INTERRUPTED
    # CPython sets a flag when a KeyboardInterrupt propagates out of exec("..."), which dataclasses use. With this flag,
    # `python -m` dies from SIGINT instead of returning the status, even if the interrupt was caught. The next exec() of
    # a string clears the flag.
    exec("")  # noqa: S102
    sys.exit(status)
