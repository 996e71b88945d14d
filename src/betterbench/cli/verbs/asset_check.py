"""``better assets check``: certify mesh files, folders of mesh files, and registered assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_listing, progress_bar, say
from betterbench.errors import BetterError, InvalidInputError

if TYPE_CHECKING:
    from betterbench.sim.asset_checks import AssetCertificate
    from betterbench.sim.asset_checks.job import Target
    from betterbench.sim.assets.importing.importer import Wishes

_PIXELS = 256
_MARKS = {"passed": "passed", "failed": "FAILED", "not_applicable": "–"}


def check_command(
    assets: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
    *,
    kind: str | None = None,
    color: str | None = None,
    size_m: float | None = None,
    mass_kg: float | None = None,
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto",
    freeze: bool = False,
    license: str | None = None,  # noqa: A002 - the name of the option
    picture: Path | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Certify mesh files, folders of mesh files, and registered assets. The exit status is 1 if an asset fails.

    Example: better assets check mug.glb --kind "coffee mug" --picture mug.png

    Args:
        assets: Files, folders and assets to check.
        kind: Name or description that determines the kind, such as "coffee mug"; default: the file name.
        color: Color word; default: the color that covers most of the surface.
        size_m: Longest side in meters; by default inferred from the format and the kind.
        mass_kg: Mass in kilograms; by default inferred from the file or the kind.
        up: Axis of the file that points up, such as --up=-z; auto chooses the axis from the format and the kind.
        freeze: Fix the movable joints of URDF and MJCF files. Without this option, files with movable joints are
            rejected.
        license: License to assume for files that do not state one.
        picture: PNG or JPEG file to write, which shows the visible parts, the collision parts and the resting pose.
        out: Folder for the certificates. Running the command again with this folder checks only the remaining assets.
        overwrite: Replace files that `better assets` did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.importing.importer import Wishes

    axis = None if up == "auto" else up
    wishes = Wishes(kind, size_m, mass_kg, axis, license or "unknown", freeze=freeze)
    _check(assets, wishes, color=color, out=out, picture=picture, overwrite=overwrite, json=json)


def _check(
    given: Sequence[str],
    wishes: Wishes,
    *,
    color: str | None,
    out: Path | None,
    picture: Path | None,
    overwrite: bool,
    json: bool,
) -> None:
    """Certify assets and print the results. Exit with status 1 if an asset fails.

    Raises:
        InvalidInputError: If no asset is given, or the picture is neither a PNG nor a JPEG file.
        UnknownNameError: If an asset is neither a file nor registered.
    """
    from betterbench.sim.asset_checks.job import certify_targets, targets_of

    if picture is not None and picture.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        problem = f"{picture} ends with {picture.suffix!r}"
        raise InvalidInputError("--picture", problem, "Choose a file name that ends with .png or .jpg")
    targets = targets_of(given, wishes, color=color)
    with progress_bar("asset certificates", len(targets)) as (bar, task):
        certificates = certify_targets(
            targets, out, on_progress=lambda p: bar.update(task, completed=p.done, total=p.planned)
        )
    if picture is not None:
        _write_pictures(list(zip(targets, certificates, strict=True)), picture, overwrite=overwrite)
    if json:
        print_json([certificate.to_json() for certificate in certificates])
    elif len(certificates) == 1:
        _print_one(certificates[0])
    else:
        _print_many(certificates)
    if not all(certificate.passed for certificate in certificates):
        raise SystemExit(1)


def _print_one(certificate: AssetCertificate) -> None:
    rows = [[check.name, _MARKS[check.outcome], check.sentence] for check in certificate.checks]
    kind = f", judged as a {certificate.kind}" if certificate.kind else ", of unknown kind"
    OUT.print(f"{certificate.asset}{kind}, license {certificate.license or 'unknown'}")
    if certificate.refused is not None:
        OUT.print(f"not imported: {certificate.refused}")
    else:
        print_listing(["check", "", ""], rows)
    OUT.print("passed" if certificate.passed else f"{len(certificate.failed) or 'import'} failed")


def _print_many(certificates: Sequence[AssetCertificate]) -> None:
    rows = [
        [one.asset, one.kind or "–", "passed" if one.passed else "FAILED", one.refused or _failures(one)]
        for one in certificates
    ]
    print_listing(["asset", "kind", "", ""], rows)
    OUT.print(f"{sum(one.passed for one in certificates)} of {len(certificates)} passed")


def _failures(certificate: AssetCertificate) -> str:
    return " ".join(f"{check.name}: {check.sentence}" for check in certificate.failed)


def _write_pictures(judged: Sequence[tuple[Target, AssetCertificate]], out: Path, *, overwrite: bool) -> None:
    """Write an image file that shows the visible parts, collision parts and resting pose of each imported asset."""
    from PIL import Image

    from betterbench.evaluation.figures.show import image_file
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFile, mark_of
    from betterbench.report.figures.image_sheet import SheetCell, image_sheet
    from betterbench.sim.asset_checks.picture import asset_pictures

    cells = []
    for target, certificate in judged:
        if certificate.refused is not None:
            continue
        try:
            images = asset_pictures(target.asset(), pixels=_PIXELS)
        except (BetterError, ValueError) as error:  # MuJoCo may reject a mesh that has failed the checks
            say(f"no picture of {certificate.asset}: {error}")
            continue
        failed = ", ".join(check.name for check in certificate.failed)
        cells.append(SheetCell(certificate.asset, images, f"failed: {failed}" if failed else "passed"))
    if not cells:
        return
    columns = 1 if len(cells) < 3 else 2
    with OutputFile(out, "assets", overwrite=overwrite):
        sheet = Image.fromarray(image_sheet([cells[k : k + columns] for k in range(0, len(cells), columns)]))
        write_durably(out, image_file(sheet, out.suffix, remark=mark_of("assets")))
    say(f"wrote {out}", whole=True)
