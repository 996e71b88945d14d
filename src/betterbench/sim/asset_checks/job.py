"""Job that certifies many assets. An interrupted job can be resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from betterbench.errors import InvalidInputError
from betterbench.jobs import JobProgress, LineJournal, run_items
from betterbench.json_form import read_bounded
from betterbench.sim.asset_checks.certificate import certify_asset
from betterbench.sim.asset_checks.check import check_names
from betterbench.sim.asset_checks.result import SCHEMA_VERSION, AssetCertificate
from betterbench.sim.assets import Asset, build
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.child import VERSION, import_safely
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.kinds import kind_of
from betterbench.sim.assets.importing.mesh_file import FORMATS as MESH_FORMATS
from betterbench.sim.assets.importing.mesh_file import MAX_FILE_BYTES
from betterbench.sim.assets.importing.object_file import FORMATS
from betterbench.sim.assets.names import shown_name

OnCertificate = Callable[[JobProgress[tuple[str, AssetCertificate]]], None]


@dataclass(frozen=True, slots=True)
class Target:
    """Asset to certify: either a mesh file with import options, or a registered asset.

    Attributes:
        name: Name of the asset in the certificate.
        file: Mesh file, or None for a registered asset.
        wishes: Import options for a mesh file. The option ``name`` also determines the kind of a registered asset.
        color: Color word. If None, a registered asset has its default color.
        look: Variant number of a registered asset.
    """

    name: str
    file: Path | None
    wishes: Wishes = field(default_factory=Wishes)
    color: str | None = None
    look: int = 0

    def key(self) -> str:
        """Return a digest of everything that determines the certificate of this target."""
        digest = hashlib.sha256(
            f"{SCHEMA_VERSION}|{check_names()}|{VERSION}|{self.name}|{asdict(self.wishes)}|{self.color}|{self.look}".encode()
        )
        if self.file is not None:
            digest.update(read_bounded(self.file, max_bytes=MAX_FILE_BYTES, cure="Reduce the mesh in a mesh editor"))
        return digest.hexdigest()[:24]

    def asset(self) -> Asset:
        """Import or build the asset.

        Raises:
            InvalidInputError: If the file cannot be imported.
            UnknownNameError: If there is no such registered asset.
        """
        if self.file is None:
            return build(self.name, look=self.look, color=self.color)
        draft = import_safely(self.file, self.wishes).draft
        return asset_of(draft, self.wishes.name or self.file.stem, color=self.color or "gray")


def targets_of(given: Sequence[str], wishes: Wishes, *, color: str | None = None) -> list[Target]:
    """Return the assets to certify, given names of assets, mesh files and folders of mesh files.

    A registered asset is given by its category ("mug"), or by category, color and variant number ("mug-red#3").

    Raises:
        InvalidInputError: If nothing is given, if a folder has no mesh file, or if a single name, size or mass is given
            for several assets.
    """
    if not given:
        raise InvalidInputError(
            "assets check", "no asset is given", "Pass the names of assets, mesh files, or folders of mesh files"
        )
    found: list[Target] = []
    for text in given:
        path = Path(text).expanduser()
        if path.is_dir():
            files = sorted(f for f in path.rglob("*") if f.suffix.lower() in MESH_FORMATS and f.is_file())
            if not files:
                raise InvalidInputError(
                    text,
                    "this folder contains no mesh file",
                    f"Use a folder with files in one of these formats: {', '.join(MESH_FORMATS)}",
                )
            found += [Target(str(file.relative_to(path)), file, wishes, color) for file in files]
        elif path.is_file() or path.suffix.lower() in FORMATS:
            found.append(Target(shown_name(path), path, wishes, color))
        else:
            found.append(_registered(text, wishes, color))
    if len(found) > 1 and (wishes.name or wishes.size_m or wishes.mass_kg):
        problem = f"one name, size or mass is given for {len(found)} assets"
        raise InvalidInputError("assets check", problem, "Check the assets one by one")
    return found


def _registered(text: str, wishes: Wishes, color: str | None) -> Target:
    rest, _, look = text.partition("#")
    category, dash, own_color = rest.rpartition("-")
    if not dash:
        category, own_color = rest, color or ""
    if look and not look.isdecimal():
        raise InvalidInputError(
            text, f"{look!r} is not a variant number", "Write the asset as CATEGORY-COLOR#NUMBER, for example mug-red#3"
        )
    return Target(category, None, wishes, own_color or None, int(look or "0"))


def certify_target(target: Target) -> AssetCertificate:
    """Import and certify one asset.

    If a file cannot be imported, its certificate contains the error message and no checks.

    Raises:
        UnknownNameError: If there is no such registered asset.
        MissingDependencyError: If a package that reads the file format is not installed.
    """
    kind = kind_of(target.wishes.name or "")
    if target.file is None:
        asset = target.asset()
        return certify_asset(asset, name=asset.identity, kind=kind)
    try:
        asset = target.asset()
    except InvalidInputError as error:
        license_name = target.wishes.license
        return AssetCertificate(
            target.name, "", None if kind is None else kind.name, target.name, license_name, (), str(error)
        )
    return certify_asset(asset, name=target.name, kind=kind)


class CertificateJournal(LineJournal):
    """The file ``certificates.jsonl``, in which certificates can be looked up by the key of the certified target."""

    def _take_in(self, lines: list[bytes]) -> None:
        self.found: dict[str, AssetCertificate] = {}
        for line in lines:
            form = json.loads(line)
            self.found[form["key"]] = AssetCertificate.from_json(form["certificate"], str(self._path))

    def keep(self, result: tuple[str, AssetCertificate]) -> None:
        """Store a certificate together with the key of its target."""
        key, certificate = result
        self._append_line({"key": key, "certificate": certificate.to_json()})
        self.found[key] = certificate


def certify_targets(
    targets: Sequence[Target], folder: Path | None = None, *, on_progress: OnCertificate | None = None
) -> list[AssetCertificate]:
    """Certify assets in the given order.

    If an output folder is given, calling the function again after an interruption resumes the job where it stopped.
    """
    keys = {target: target.key() for target in targets}

    def work(waiting: list[Target]) -> Iterator[tuple[str, AssetCertificate]]:
        for target in waiting:
            yield keys[target], certify_target(target)

    if folder is None:
        made: dict[str, AssetCertificate] = {}
        run_items(keys, is_done=lambda _: False, work=work, keep=lambda f: made.update([f]), on_progress=on_progress)
        return [made[keys[target]] for target in targets]
    folder.mkdir(parents=True, exist_ok=True)
    with CertificateJournal(folder / "certificates.jsonl") as journal:
        run_items(
            keys,
            is_done=lambda target: keys[target] in journal.found,
            work=work,
            keep=journal.keep,
            on_progress=on_progress,
        )
        return [journal.found[keys[target]] for target in targets]
