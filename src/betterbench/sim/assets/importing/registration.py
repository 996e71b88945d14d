"""Registration of an imported mesh as a category of assets that tasks can name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from betterbench.sim.assets.authoring.draft import Draft
from betterbench.sim.assets.authoring.registry import categories, generator
from betterbench.sim.assets.importing.child import import_safely
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.review.replay import reviewed
from betterbench.sim.assets.licenses import require_license
from betterbench.tasks.user_files import loading_folder


@dataclass(frozen=True, slots=True)
class MeshImport:
    """Mesh file that is registered as a category of assets, with its import options."""

    category: str
    path: Path
    wishes: Wishes


_IMPORTS: dict[str, MeshImport] = {}


def mesh_imports() -> tuple[MeshImport, ...]:
    """Return the registered mesh files in the order of their registration."""
    known = set(categories())
    return tuple(found for found in _IMPORTS.values() if found.category in known)


def imported(
    category: str,
    path: Path | str,
    *,
    color: str,
    name: str | None = None,
    size_m: float | None = None,
    mass_kg: float | None = None,
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None,
    license: str = "unknown",  # noqa: A002 - the term for assets
    source: str | None = None,
    author: str | None = None,
    any_license: bool = False,
    freeze: bool = False,
    keeps_upright: bool = False,
    review: Path | str | None = None,
) -> None:
    """Register the object in a file as a category of assets. The file is imported when the category is first built.

    All variants of the category are the same object. In a task file, a relative path is relative to the folder of the
    task file.

    Args:
        category: Unique name by which tasks refer to the asset.
        path: File of the object: GLB, glTF, OBJ, STL, PLY, URDF or MJCF.
        color: Color word of the object.
        name: Name or description that determines the kind of object ("coffee mug"). If None, the category is used.
        size_m: Longest side [m]. If None, it is determined from the unit of the file format and the usual sizes of this
            kind of object.
        mass_kg: Mass [kg]. If None, the mass stated in the file is used, or else the usual mass of an object of this
            kind and size.
        up: Axis of the file's frame that points up. If None, it is determined from the file format or from the most
            stable pose.
        license: License of the mesh, shown in lists of sources.
        source: Where the mesh comes from, shown in lists of sources. If None, the name of the file is shown.
        author: Author of the mesh, shown in lists of sources.
        any_license: Whether restricted and unknown licenses are allowed.
        freeze: Whether movable joints of a URDF or MJCF file are fixed in place. If False, a movable joint raises an
            error.
        keeps_upright: Whether the object, such as a cup with a drink, must not lie on its side in a container.
        review: Review file written by ``better review``. The accepted changes in it are applied. If the object was
            rejected or has no verdict, the first build of the category raises an error.

    Raises:
        InvalidInputError: If an asset with this name exists, or if the license is not free and ``any_license`` is
            False.
    """
    require_license(
        f"asset category {category!r}",
        license,
        any_license=any_license,
        option='Set license="CC BY 4.0" or the name of another license, or set any_license=True to use it anyway',
    )
    folder = loading_folder() or Path.cwd()
    file = (folder / Path(path).expanduser()).absolute()
    reviews = None if review is None else (folder / Path(review).expanduser()).absolute()
    wishes = Wishes(name or category, size_m, mass_kg, up, license, source, author, freeze)

    def make(_rng: np.random.Generator, _color: str) -> Draft:
        imported = import_safely(file, wishes)
        return (imported if reviews is None else reviewed(imported, file, reviews)).draft

    # The file in the name distinguishes two files that are registered under the same category name.
    make.__qualname__ = f"the import of {file}"
    generator(category, colors=(color,), looks=1, unseen_looks=1, keeps_upright=keeps_upright)(make)
    _IMPORTS[category] = MeshImport(category, file, wishes)
