"""Import of meshes from a user's catalogue, for objects that the library does not contain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.errors import one_line
from betterbench.generation.building.casting import LEAST_SCORE, fitting, name_problem
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.sim.asset_checks.job import Target, certify_target
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.search import Catalogue, Filters
from betterbench.sim.assets.catalogue.sources.procedural import NAME
from betterbench.sim.assets.folders.job import ImportRequest, import_assets
from betterbench.sim.assets.folders.rows import request_of_row
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.user_files import load_asset_folders

IMPORTED = "imported"
"""Folder of imported assets in a build folder, which other subcommands load with --asset-dir."""
MOST_MESHES = 3
"""Maximum number of imported meshes per description. Successive attempts to build a task use different meshes."""
_SEARCHED = 20


@dataclass(frozen=True, slots=True)
class ImportedMeshes:
    """Result of importing meshes for a build.

    Attributes:
        names: Categories of the imported assets.
        refused: Catalogue rows that match a description but cannot be used, with the reason for each.
    """

    names: tuple[str, ...] = ()
    refused: tuple[tuple[str, str], ...] = ()


def import_missing(scenarios: Sequence[Scenario], library: Catalogue, user: Catalogue, out: Path) -> ImportedMeshes:
    """Import, certify and load meshes for descriptions that match no library object.

    The words of a description are used to search for meshes. A mesh is imported if its name contains these words, its
    license is free, and it passes ``better assets check``. If the call is repeated, assets that were already imported
    are kept.

    Args:
        scenarios: Scenarios of the build.
        library: Catalogue of the registered assets.
        user: Catalogue written by ``better assets index``.
        out: Folder of the build.

    Raises:
        RunConflictError: If another process is writing into the folder of the imported assets.
    """
    rows = {row.id: row for described in _missing(scenarios, library) for row in _found(described, user)}
    refused: list[tuple[str, str]] = []
    requests = []
    for row in rows.values():
        request = request_of_row(row)
        problem = _problem_of(request)
        if problem:
            refused.append((row.id, problem))
        else:
            requests.append(request)
    if not requests:
        return ImportedMeshes((), tuple(refused))
    report = import_assets(requests, out / IMPORTED)
    refused += report.failed
    names = (*report.kept, *report.made)
    if names:
        load_asset_folders([out / IMPORTED])
    return ImportedMeshes(names, tuple(refused))


def _missing(scenarios: Sequence[Scenario], library: Catalogue) -> Iterator[DescribedObject]:
    """Yield the distinct descriptions that match no suitable object in the library."""
    asked: set[tuple[str, str]] = set()
    for scenario in scenarios:
        template = TEMPLATES[scenario.template]
        for group in template.groups:
            for described in scenario.groups.get(group.group_id, ()):
                known = (described.asset_query, group.group_id)
                if known not in asked and not fitting(described, group, template, library, set())[0]:
                    yield described
                asked.add(known)


def _found(described: DescribedObject, user: Catalogue) -> list[CatalogueEntry]:
    """Return the rows of the user's catalogue that best match a description.

    Only rows with a mesh on this machine are used.
    """
    hits = user.search(described.asset_query, limit=_SEARCHED, filters=Filters(license="free"))
    rows = [hit.entry for hit in hits if hit.score >= LEAST_SCORE and hit.entry.source != NAME and hit.entry.path]
    return [row for row in rows if not name_problem(described.asset_query, row)][:MOST_MESHES]


def _problem_of(request: ImportRequest) -> str:
    """Return the reason why a mesh fails its certificate, or an empty string if it passes."""
    certificate = certify_target(Target(request.path.name, request.path, request.wishes, request.color))
    said = certificate.refused or "; ".join(f"{check.name}: {check.sentence}" for check in certificate.failed)
    return one_line(said, most=300)
