"""``better worlds``: list the worlds that need a separate simulator, or install such a simulator."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.errors import InvalidInputError, UnknownNameError


def worlds_command(
    what: Annotated[Literal["list", "install"], tyro.conf.Positional] = "list",
    name: Annotated[str | None, tyro.conf.Positional] = None,
    *,
    json: bool = False,
) -> None:
    """List the worlds with a separate simulator, or install one of these simulators into its own environment.

    Packages are pinned by hash and installed in the user's cache; betterbench's environment does not change.

    Example: better worlds install libero

    Args:
        what: Action: list or install.
        name: World to install.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.worlds import all_worlds

    apart = {world.name: world.installation for world in all_worlds() if world.installation is not None}
    if what == "install":
        if name is None:
            raise InvalidInputError("worlds install", "no world was given", f"Choose one of {', '.join(apart)}")
        if name not in apart:
            raise UnknownNameError("world", name, apart)
        world = apart[name]
        say(f"{name}: {'is installed' if world.is_installed else f'is being installed, {world.size}'}")
        folder = world.install(waits=lambda: say(f"{name}: another installation is in progress; waiting for it to end"))
        if json:
            print_json({"world": name, "folder": str(folder)})
        else:
            OUT.print(str(folder), markup=False, soft_wrap=True)
        return
    if name is not None:
        raise InvalidInputError("worlds list", f"unexpected argument {name!r}", "Leave out this argument")
    rows = [
        [world.name, "installed" if world.is_installed else "not installed", world.summary] for world in apart.values()
    ]
    if json:
        print_json([dict(zip(("world", "state", "what it is"), row, strict=True)) for row in rows])
        return
    print_table(["world", "state", "what it is"], rows)
    for world in apart.values():
        if not world.is_installed:
            OUT.print(f"\nbetter worlds install {world.name}", markup=False)
