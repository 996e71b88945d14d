"""``better assets``: overview of the nested commands. Each nested command has its own module."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

What = Literal["index", "search", "show", "licenses", "import", "check"]


def assets_command(what: Annotated[What, tyro.conf.Positional, tyro.conf.arg(metavar="COMMAND")]) -> None:
    """Index, search, show, import or check assets, or list their licenses.

    index adds asset sources to the catalogue: built-in generators, folders of meshes, Objaverse.

    search finds assets by description.

    show prints one asset.

    licenses counts licenses by source.

    import makes assets from mesh, URDF and MJCF files.

    check certifies files, folders and registered assets.

    Use `better assets COMMAND --help` to see the options of a command.

    Example: better assets search "a shiny red apple" --out sheet.png

    Args:
        what: Nested command: index, search, show, licenses, import or check.
    """
    raise AssertionError(f"this function cannot run 'better assets {what}'; call betterbench.cli.main instead")
