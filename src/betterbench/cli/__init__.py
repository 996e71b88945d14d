"""The command line."""

import sys


def main() -> None:
    """Entry point of the command ``better``."""
    if sys.argv[1:] == ["--version"]:
        from betterbench import __version__

        sys.stdout.write(f"betterbench {__version__}\n")
        return
    from betterbench.cli.main import main as run  # imports tyro, which --version does not need

    sys.exit(run())
