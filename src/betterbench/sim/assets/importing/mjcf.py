"""Reader for MJCF files. MuJoCo compiles the file, and all bodies in it are merged into one rigid body.

The XML document is checked before MuJoCo parses it. The file names in it are then replaced, the resolver reads the
meshes and textures, and their contents are passed to MuJoCo as bytes. A malicious file can crash or hang MuJoCo's
parser and compiler, which are written in C++. Therefore an untrusted file is only read in a process with limited time
and memory (``child``).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from PIL import Image

from betterbench.errors import InvalidInputError, one_line
from betterbench.sim.assets.importing import rigid
from betterbench.sim.assets.importing.mesh_file import LARGEST_IMAGE, MAX_FACES, FolderResolver, check_picture
from betterbench.sim.assets.importing.raw import RawMesh, RawPart, Rgba, Stated
from betterbench.sim.assets.importing.rigid import PointMass, combined, pose

_REFUSED = {
    "attach": "another model",
    "composite": "a deformable body",
    "flex": "a deformable body",
    "flexcomp": "a deformable body",
    "hfield": "a height field",
    "model": "another model",
    "replicate": "copies",
    "skin": "a skin",
}
"""MJCF elements that are rejected. A tabletop object does not need them, and they could use unlimited memory or read
further files.
"""

_GEOM = mujoco.mjtGeom
_FLAT = (int(_GEOM.mjGEOM_PLANE), int(_GEOM.mjGEOM_HFIELD))
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_UNCOLORED = np.array([0.5, 0.5, 0.5, 1.0])
"""Default geom color, which means that the material determines the color."""
_CURE = "Export the object again, or import its mesh instead"


def read_mjcf(root: ET.Element, files: FolderResolver, where: str, *, freeze: bool = False) -> RawMesh:
    """Merge the bodies of an MJCF file into one rigid body, in the world frame of the file.

    Planes are left out. If the file has bodies, geoms of the world body are left out as well. The visual shape consists
    of the geoms without contacts, or of all geoms if every geom has contacts.

    Args:
        root: The ``mujoco`` element of the file.
        files: Resolver for the file's folder.
        where: Name of the file, for messages.
        freeze: Whether movable joints are fixed at their reference position. If False, a movable joint raises an error.

    Raises:
        InvalidInputError: If the file does not describe one rigid body, has an unsupported part, or is rejected by
            MuJoCo.
    """
    states_mass = _checked(root, where)
    # Reserved memory is not needed, and reserving it for a billion key frames takes minutes.
    for size in root.findall("size"):
        root.remove(size)
    assets = _with_bytes(root, files, where)
    text = ET.tostring(root, encoding="unicode")
    try:
        model = mujoco.MjModel.from_xml_string(text, assets)
        if states_mass and any(not _is_seen_or_felt(model, geom) for geom in range(model.ngeom)):
            model = _with_weightless_regions(text, assets)
    except ValueError as error:
        problem = f"MuJoCo rejects it ({one_line(error, most=200)})"
        raise InvalidInputError(where, problem, _CURE) from error
    notes = _require_rigid(model, where, freeze=freeze)
    return _Compiled(model, where).mesh(root.get("model", ""), notes, states_mass=states_mass)


def _with_weightless_regions(text: str, assets: dict[str, bytes]) -> Any:  # noqa: ANN401 - of MuJoCo
    """Compile an MJCF file, but set the mass of geoms that only mark a region to zero.

    Such geoms are invisible, have no contacts, and have no stated mass. If a moving body would then have no mass at
    all, all masses stay as MuJoCo has computed them.
    """
    spec = mujoco.MjSpec.from_string(text, assets=assets)
    model = spec.compile()
    for geom in spec.geoms:
        if not _is_seen_or_felt(model, geom.id) and np.isnan(geom.mass):
            geom.mass = 0.0
    try:
        return spec.compile()
    except ValueError:
        return model


def _is_seen_or_felt(model: Any, geom: int) -> bool:  # noqa: ANN401 - of MuJoCo
    """Return whether a geom is visible or has contacts. If neither is the case, the geom only marks a region."""
    touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
    return bool(touches or _rgba(model, geom)[3] > 0.0)


def _rgba(model: Any, geom: int) -> Rgba:  # noqa: ANN401 - of MuJoCo
    material = int(model.geom_matid[geom])
    found = model.geom_rgba[geom]
    if material >= 0 and np.allclose(found, _UNCOLORED):
        found = model.mat_rgba[material]
    r, g, b, a = (float(v) for v in np.clip(found, 0.0, 1.0))
    return r, g, b, a


def _checked(root: ET.Element, where: str) -> bool:
    """Raise an error if the MJCF file has unsupported elements. Return whether the file states any masses."""
    bodies = shapes = 0
    for element in root.iter():
        if element.tag in _REFUSED:
            raise InvalidInputError(where, f"it contains {_REFUSED[element.tag]} (element {element.tag})", _CURE)
        bodies += element.tag == "body"
        shapes += element.tag == "geom"
    if bodies > rigid.MOST_BODIES or shapes > rigid.MOST_SHAPES:
        problem = f"it has {bodies} bodies with {shapes} geoms"
        cure = f"Import an object of at most {rigid.MOST_BODIES} bodies and {rigid.MOST_SHAPES} geoms"
        raise InvalidInputError(where, problem, cure)
    return root.find(".//inertial") is not None or any(
        geom.get("mass") or geom.get("density") for geom in root.iter("geom")
    )


def _with_bytes(root: ET.Element, files: FolderResolver, where: str) -> dict[str, bytes]:
    """Read all files to which an MJCF document refers, and return their contents, keyed by new file names.

    In the document, the file names are replaced by the new ones.
    """
    folders = {"mesh": "", "texture": ""}
    strips = False
    for compiler in root.iter("compiler"):
        both = compiler.attrib.pop("assetdir", "")
        for kind, attribute in (("mesh", "meshdir"), ("texture", "texturedir")):
            folders[kind] = compiler.attrib.pop(attribute, both or folders[kind])
        strips |= compiler.attrib.pop("strippath", "false") == "true"
    found: dict[str, bytes] = {}
    for element in list(root.iter()):
        for attribute in [name for name in element.attrib if name.startswith("file")]:
            if element.tag not in folders:
                problem = f"its element {one_line(element.tag, most=40)} refers to a file"
                raise InvalidInputError(where, problem, "Remove this element, since only meshes and textures are read")
            given = element.attrib.pop(attribute)
            name = PurePosixPath(given).name if strips else given
            if not element.get("name"):
                element.set("name", PurePosixPath(given).stem)
            data = files.get(f"{folders[element.tag].rstrip('/')}/{name}".lstrip("/") if folders[element.tag] else name)
            own = f"file{len(found)}{PurePosixPath(name).suffix.lower()}"
            if element.tag == "texture":
                data, own = _png(data, name, where), f"file{len(found)}.png"
            found[own] = data
            element.set(attribute, own)
            element.attrib.pop("content_type", None)
    return found


def _png(data: bytes, name: str, where: str) -> bytes:
    """Convert an image to PNG, scaled down to the maximum texture size."""
    check_picture(data, one_line(name, most=80), where)
    picture = Image.open(io.BytesIO(data)).convert("RGB")
    picture.thumbnail((LARGEST_IMAGE, LARGEST_IMAGE))
    written = io.BytesIO()
    picture.save(written, "PNG")
    return written.getvalue()


def _require_rigid(model: Any, where: str, *, freeze: bool) -> tuple[str, ...]:  # noqa: ANN401 - of MuJoCo
    """Require that a model is one rigid object, and return a note for each joint that was fixed in place.

    Raises InvalidInputError if the model has separate objects, or if it has movable joints and ``freeze`` is False.
    """
    free = [j for j in range(model.njnt) if int(model.jnt_type[j]) == _FREE]
    if len(free) > 1:
        first, second = (_body_name(model, model.jnt_bodyid[j]) for j in free[:2])
        raise InvalidInputError(
            where, f"its bodies {first} and {second} are separate objects", "Import one object per file"
        )
    moving = [j for j in range(model.njnt) if j not in free]
    said = [_joint_name(model, j) for j in moving]
    if moving and not freeze:
        cure = "Use --freeze to fix all joints at their reference position, or import a single body"
        raise InvalidInputError(where, f"its joint {said[0]} is movable", cure)
    return tuple(f"joint {name} is fixed at its reference" for name in said)


def _joint_name(model: Any, joint: int) -> str:  # noqa: ANN401
    name = model.joint(joint).name
    return repr(one_line(name, most=60)) if name else f"of body {_body_name(model, model.jnt_bodyid[joint])}"


def _body_name(model: Any, body: int) -> str:  # noqa: ANN401
    return repr(one_line(model.body(body).name or f"number {body}", most=60))


class _Compiled:
    """Shapes, colors and masses of a compiled MuJoCo model in its reference configuration."""

    def __init__(self, model: Any, where: str) -> None:  # noqa: ANN401 - of MuJoCo
        self._model, self._where = model, where
        self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)

    def mesh(self, name: str, notes: tuple[str, ...], *, states_mass: bool) -> RawMesh:
        m = self._model
        geoms = [g for g in range(m.ngeom) if int(m.geom_type[g]) not in _FLAT and _is_seen_or_felt(m, g)]
        of_bodies = [g for g in geoms if m.geom_bodyid[g] != 0]
        geoms = of_bodies or geoms
        if not geoms:
            raise InvalidInputError(self._where, "none of its bodies has a shape", _CURE)
        touching = [g for g in geoms if m.geom_contype[g] or m.geom_conaffinity[g]]
        only_seen = [g for g in geoms if g not in touching]
        groups = {int(m.geom_group[g]) for g in only_seen}
        seen = [g for g in geoms if g in only_seen or not only_seen or int(m.geom_group[g]) in groups]
        seen = [g for g in seen if _rgba(m, g)[3] > 0.0] or geoms
        parts = tuple(part for g in seen for part in self._parts(g))
        if sum(len(part.faces) for part in parts) > MAX_FACES:
            cure = "Reduce the mesh in a mesh editor"
            raise InvalidInputError(self._where, f"it has more than {MAX_FACES:,} triangles", cure)
        hulls = tuple(self._placed(g, *self._shape(g)[:2])[0] for g in touching)
        mass = combined(list(self._masses())) if states_mass else None
        stated = Stated(hulls=hulls, name=one_line(name, most=60), notes=notes)
        if mass is not None:
            stated = Stated(mass.mass_kg, mass.center, mass.inertia, hulls, stated.name, notes)
        return RawMesh(parts, "z", 1.0, stated)

    def _masses(self) -> Iterator[PointMass]:
        m, d = self._model, self._data
        for body in range(1, m.nbody):
            turn = d.ximat[body].reshape(3, 3)
            inertia = turn @ np.diag(m.body_inertia[body]) @ turn.T
            yield PointMass(float(m.body_mass[body]), d.xipos[body].copy(), inertia)

    def _shape(self, geom: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return the vertices (in the geom's frame) and the faces of a geom, and its texture coordinates per corner."""
        m = self._model
        kind, size = _GEOM(int(m.geom_type[geom])), m.geom_size[geom]
        if kind == _GEOM.mjGEOM_MESH:
            return self._mesh(int(m.geom_dataid[geom]))
        if kind == _GEOM.mjGEOM_BOX:
            return (*rigid.box(size), None)
        if kind == _GEOM.mjGEOM_SPHERE:
            return (*rigid.ellipsoid(np.full(3, size[0])), None)
        if kind == _GEOM.mjGEOM_ELLIPSOID:
            return (*rigid.ellipsoid(size), None)
        if kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
            make = rigid.cylinder if kind == _GEOM.mjGEOM_CYLINDER else rigid.capsule
            return (*make(float(size[0]), float(size[1])), None)
        raise InvalidInputError(self._where, f"a geom has the type {kind.name}, which is not supported", _CURE)

    def _mesh(self, mesh: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        m = self._model
        start, count = m.mesh_vertadr[mesh], m.mesh_vertnum[mesh]
        vertices = m.mesh_vert[start : start + count].astype(np.float64)
        rows = slice(m.mesh_faceadr[mesh], m.mesh_faceadr[mesh] + m.mesh_facenum[mesh])
        faces = m.mesh_face[rows].astype(np.int64)
        if m.mesh_texcoordadr[mesh] < 0:
            return vertices, faces, None
        uv = m.mesh_texcoord[m.mesh_texcoordadr[mesh] :].astype(np.float64)
        corners = uv[m.mesh_facetexcoord[rows].ravel()]
        # The rows of a texture start at the top in MuJoCo, but at the bottom in betterbench.
        return vertices, faces, np.column_stack([corners[:, 0], 1.0 - corners[:, 1]])

    def _placed(self, geom: int, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = self._data
        place = pose(d.geom_xpos[geom], d.geom_xmat[geom].reshape(3, 3))
        return vertices @ place[:3, :3].T + place[:3, 3], faces

    def _parts(self, geom: int) -> Iterator[RawPart]:
        vertices, faces, corners = self._shape(geom)
        vertices, faces = self._placed(geom, vertices, faces)
        rgba, (image, is_flat) = _rgba(self._model, geom), self._image(geom)
        name = one_line(self._model.geom(geom).name or f"geom {geom}", most=60)
        # MuJoCo would map such a texture itself, for example onto a cube. The mean color is close enough.
        if image is not None and (corners is None or not is_flat):
            r, g, b = (float(v) / 255.0 for v in image.reshape(-1, 3).mean(axis=0))
            rgba, image = (rgba[0] * r, rgba[1] * g, rgba[2] * b, rgba[3]), None
        if image is None or corners is None:
            yield RawPart(name, vertices, faces, rgba)
            return
        own = np.arange(3 * len(faces)).reshape(-1, 3)
        yield RawPart(name, vertices[faces.ravel()], own, rgba, image, corners)

    def _image(self, geom: int) -> tuple[np.ndarray | None, bool]:
        """Return the texture image of a geom, and whether the texture is a flat image rather than a cube map.

        The image is None if the geom has no texture.
        """
        m = self._model
        material = int(m.geom_matid[geom])
        texture = -1 if material < 0 else int(m.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
        if texture < 0:
            return None, False
        height, width, channels = (int(v[texture]) for v in (m.tex_height, m.tex_width, m.tex_nchannel))
        if channels < 3:
            return None, False
        start = int(m.tex_adr[texture])
        pixels = m.tex_data[start : start + height * width * channels].reshape(height, width, channels)
        is_flat = int(m.tex_type[texture]) == int(mujoco.mjtTexture.mjTEXTURE_2D)
        return np.ascontiguousarray(pixels[:, :, :3]), is_flat
