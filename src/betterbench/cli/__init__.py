"""The command line."""

import sys


def main() -> None:
    """Entry point of the command ``better``."""
    from betterbench.cli.main import main as run  # noqa: PLC0415 - importing the library takes a second, --version none

    if sys.argv[1:] == ["--version"]:
        from betterbench import __version__  # noqa: PLC0415

        sys.stdout.write(f"betterbench {__version__}\n")
        return
    sys.exit(run())
