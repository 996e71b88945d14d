"""Imported objects as files: a draft and what is known about it, in one archive of NumPy without pickle."""

from __future__ import annotations

import io
import zipfile
from dataclasses import asdict
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose
from betterbench.interface.state import Region
from betterbench.json_form import dump_json, parse_json
from betterbench.sim.assets.asset import CollisionPart, Grasp, Texture, VisualPart
from betterbench.sim.assets.authoring.draft import Draft
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.importing.hulls import Fit
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.kinds import kind_of

_HEAD = "head"
_CURE = "Delete the file; the object is imported again"


def to_bytes(imported: Imported) -> bytes:
    """Return an imported object as bytes; equal objects give equal bytes."""
    draft, arrays = imported.draft, dict[str, np.ndarray]()
    visual, collision = [], []
    for k, part in enumerate(draft.parts):
        if isinstance(part, VisualPart):
            visual.append(
                {
                    "name": part.name,
                    "rgba": part.rgba,
                    "specular": part.specular,
                    "shininess": part.shininess,
                    "smooth": part.smooth,
                    "part": k,
                    "painted": part.texture is not None,
                }
            )
            arrays |= {f"{k}_vertices": part.vertices, f"{k}_faces": part.faces}
            if part.texture is not None:
                arrays |= {f"{k}_pixels": part.texture.pixels, f"{k}_uv": part.texture.uv}
                if part.texture.corners is not None:
                    arrays[f"{k}_corners"] = part.texture.corners
        else:
            collision.append({"friction": part.friction, "part": k})
            if part.vertices is None:
                raise AssertionError("an imported object has hulls only")
            arrays[f"{k}_vertices"] = part.vertices
    head = {
        "shape": draft.shape,
        "description": draft.description,
        "tags": draft.tags,
        "mass_kg": draft.mass_kg,
        "visual": visual,
        "collision": collision,
        "body": None if draft.body is None else asdict(draft.body),
        "grasps": [asdict(grasp) for grasp in draft.grasps],
        "regions": [asdict(region) for region in draft.regions],
        "parameters": dict(draft.parameters),
        "source": draft.source,
        "license": draft.license,
        "fit": asdict(imported.fit),
        "kind": None if imported.kind is None else imported.kind.name,
        "notes": imported.notes,
    }
    arrays[_HEAD] = np.frombuffer(dump_json(head), dtype=np.uint8)
    return _archive(arrays)


def _archive(arrays: dict[str, np.ndarray]) -> bytes:
    """Return arrays as an archive whose bytes depend on nothing else: np.savez writes the time."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(arrays):
            one = io.BytesIO()
            np.lib.format.write_array(one, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), one.getvalue(), zipfile.ZIP_DEFLATED)
    return written.getvalue()


def from_bytes(data: bytes, where: str) -> Imported:
    """Return the imported object that bytes of :func:`to_bytes` describe.

    Raises:
        InvalidInputError: If they do not.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: _frozen(archive[name]) for name in archive.files}
        return _imported(parse_json(arrays.pop(_HEAD).tobytes()), arrays)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        problem = f"it is not an imported object ({type(error).__name__})"
        raise InvalidInputError(where, problem, _CURE) from error


def _imported(head: dict[str, Any], arrays: dict[str, np.ndarray]) -> Imported:
    parts: dict[int, VisualPart | CollisionPart] = {}
    for form in head["visual"]:
        k = form["part"]
        texture = None
        if form["painted"]:
            texture = Texture(arrays[f"{k}_pixels"], arrays[f"{k}_uv"], arrays.get(f"{k}_corners"))
        parts[k] = VisualPart(
            form["name"],
            arrays[f"{k}_vertices"],
            arrays[f"{k}_faces"],
            tuple(form["rgba"]),
            form["specular"],
            form["shininess"],
            texture,
            form["smooth"],
        )
    for form in head["collision"]:
        k = form["part"]
        parts[k] = CollisionPart(
            "hull", (0.0, 0.0, 0.0), vertices=arrays[f"{k}_vertices"], friction=tuple(form["friction"])
        )
    body = head["body"]
    draft = Draft(
        shape=head["shape"],
        description=head["description"],
        tags=tuple(head["tags"]),
        mass_kg=head["mass_kg"],
        parts=tuple(parts[k] for k in sorted(parts)),
        body=MassProperties(body["mass_kg"], tuple(body["center_of_mass"]), tuple(body["inertia"])),
        grasps=tuple(_grasp(form) for form in head["grasps"]),
        regions=tuple(
            Region(r["name"], tuple(r["position"]), tuple(r["half_size"]), tuple(r["quaternion"]))
            for r in head["regions"]
        ),
        parameters=head["parameters"],
        source=head["source"],
        license=head["license"],
    )
    kind = None if head["kind"] is None else kind_of(head["kind"])
    return Imported(draft, Fit(**head["fit"]), kind, tuple(head["notes"]))


def _grasp(form: dict[str, Any]) -> Grasp:
    pose = Pose(tuple(form["pose"]["position"]), tuple(form["pose"]["quaternion"]))
    return Grasp(**{**form, "pose": pose})


def _frozen(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
