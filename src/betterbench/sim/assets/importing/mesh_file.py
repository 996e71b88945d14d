"""Reader for untrusted mesh files: GLB, glTF, OBJ, STL and PLY.

Files are read with trimesh. Every file that the mesh file refers to must be in the folder of the mesh file. URLs,
references to other folders, and links that lead out of the folder raise an error.
"""

from __future__ import annotations

import base64
import codecs
import hashlib
import io
import os
import re
import struct
import warnings
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh
import trimesh.resolvers
from PIL import Image, UnidentifiedImageError

from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.installation import missing_extra
from betterbench.json_form import read_bounded
from betterbench.sim.assets.gltf import description_of
from betterbench.sim.assets.importing.plain_gltf import plain
from betterbench.sim.assets.importing.raw import RawMesh, RawPart, Rgba

MAX_FILE_BYTES = 256 << 20
MAX_FACES = 2_000_000
MAX_IMAGE_PIXELS = 64 << 20
LARGEST_IMAGE = 1024
"""Maximum side of a stored texture [pixel]. Larger textures are scaled down."""

FORMATS = {".glb": "glb", ".gltf": "gltf", ".obj": "obj", ".stl": "stl", ".ply": "ply"}
_RULES: dict[str, tuple[str | None, float | None]] = {"glb": ("y", 1.0), "gltf": ("y", 1.0)}
"""Up axis and unit [m] that a format defines (glTF 2.0, section 3.4). Formats that are not listed define neither."""

_VERTEX_ZERO = re.compile(rb"^[ \t]*f[ \t](?:[^\n#]*[ \t])?0(?:[/ \t\r\n]|\Z)", re.MULTILINE)
"""Line of an OBJ file with a triangle that refers to vertex 0. trimesh would read it as the last vertex."""
_MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_COMMENTED_MATERIALS = re.compile(rb"^[ \t]*#[^\n]*mtllib[^\n]*$", re.MULTILINE)
"""Lines of an OBJ file that name a material file (MTL), and comments that trimesh would mistake for such lines."""
_OPTION = re.compile(r"-([a-z]+)((?:[ \t]+[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?|[ \t]+o(?:n|ff)\b|[ \t]+[rgbmlz]\b)*)[ \t]+")
"""Option with its values. Such options may precede the file name of a texture in an MTL file."""
_USED_MATERIAL = re.compile(rb"usemtl[ \t]+([^\r\n]*)")
_MATERIAL_LINE = re.compile(r"\s*(newmtl|map_kd)\s+(.*)", re.IGNORECASE)
"""Lines of an OBJ file that use a material, and lines of an MTL file that begin a material or name its texture."""
_NEUTRAL = {"s": 1.0, "o": 0.0, "t": 0.0}
"""MTL options that scale or shift a texture, and the value with which each option has no effect."""
_CURE = "Export the object again, or leave out this file"
_PICTURES = frozenset((".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".webp"))
_READABLE_EXTENSIONS = frozenset(
    (
        "EXT_texture_webp",
        "KHR_draco_mesh_compression",
        "KHR_materials_unlit",
        "KHR_materials_specular",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    )
)


class FolderResolver(trimesh.resolvers.Resolver):
    """Resolver that opens the files that a mesh file refers to. It only opens files in the folder of the mesh file.

    The first error is kept in ``problem``, because trimesh silently drops a material whose file it cannot read.

    Attributes:
        problem: The first error, or None if there was no error.
        digests: SHA-256 of each file that was read, keyed by its path in the folder.
    """

    def __init__(self, folder: Path, where: str, *, at: str = "", above: FolderResolver | None = None) -> None:
        """Resolve file names in a folder.

        Args:
            folder: The folder. Files outside it are not opened.
            where: Name of the mesh file, for messages.
            at: Subfolder of ``folder`` to which the file names are relative.
            above: Resolver of a URDF or MJCF file that refers to the mesh file. It records all files that are read, and
                their total size. None if no file refers to the mesh file.
        """
        self._folder, self._where, self._at = folder.resolve(), where, at
        self._above = above
        self._used: frozenset[str] | None = None
        self.problem: BetterError | None = None
        self.digests: dict[str, str] = {} if above is None else above.digests
        self._read_bytes = 0

    def get(self, name: str) -> bytes:
        """Return the content of a file.

        Raises InvalidInputError if the file is outside the folder, missing or too large.
        """
        try:
            return self._read(name)
        except BetterError as error:
            self.problem = self.problem or error
            raise

    def _read(self, name: str) -> bytes:
        asked = PurePosixPath(unquote(_texture_file(str(name).strip(), self._where)).replace("\\", "/"))
        shown = one_line(repr(str(name)), most=120)
        problem = f"it refers to {shown}, which is outside its folder"
        inside = os.path.normpath(PurePosixPath(self._at) / asked)
        if asked.is_absolute() or inside.startswith("..") or ":" in str(asked) or "\0" in str(asked):
            raise InvalidInputError(self._where, problem, "Put the file next to the mesh and refer to it by name")
        path = (self._folder / inside).resolve()
        if not path.is_relative_to(self._folder):
            raise InvalidInputError(self._where, problem, "Put the file itself next to the mesh, instead of a link")
        if not path.is_file():
            raise InvalidInputError(self._where, f"it refers to {shown}, which does not exist", _CURE)
        found = read_bounded(path, max_bytes=MAX_FILE_BYTES - self._total(), cure=_CURE)
        if path.suffix.lower() in _PICTURES:
            check_picture(found, one_line(path.name, most=80), self._where)
        self._count(len(found))
        self.digests[inside] = hashlib.sha256(found).hexdigest()
        if path.suffix.lower() != ".mtl":
            return found
        # After a byte order mark, trimesh would drop the first material.
        return _without_unused_textures(found.removeprefix(codecs.BOM_UTF8), self._used)

    def holds(self, name: str) -> bool:
        """Return whether the folder contains a file with the given name."""
        inside = os.path.normpath(PurePosixPath(self._at) / name)
        return not inside.startswith(("..", "/")) and "\0" not in inside and (self._folder / inside).is_file()

    def _total(self) -> int:
        return self._read_bytes if self._above is None else self._above._total()

    def _count(self, size: int) -> None:
        if self._above is not None:
            self._above._count(size)
        self._read_bytes += size

    def below(self, name: str, where: str) -> FolderResolver:
        """Return a resolver for the references in the given file. They are relative to the folder of the file."""
        at = os.path.normpath(PurePosixPath(self._at) / PurePosixPath(name).parent)
        return FolderResolver(self._folder, where, at="" if at == "." else at, above=self)

    def using(self, materials: frozenset[str]) -> FolderResolver:
        """Return a resolver that only reads the textures of the given materials.

        Without it, trimesh would also read the textures of materials that are not used.
        """
        resolver = FolderResolver(self._folder, self._where, at=self._at, above=self)
        resolver._used = materials
        return resolver

    def keys(self) -> list[str]:
        """Return an empty list. trimesh needs file names only for searches by pattern, which are not supported."""
        return []

    def write(self, name: str, data: bytes) -> None:  # noqa: ARG002 - of the base class
        """Raise an error. trimesh writes through a resolver only when it exports a mesh, which never happens here."""
        raise InvalidInputError(
            self._where, f"an import must not write files, but trimesh tried to write {one_line(name, most=120)}", _CURE
        )

    def namespaced(self, namespace: str) -> FolderResolver:  # noqa: ARG002 - of the base class
        """Return this resolver, because trimesh already includes the subfolder in the file names that it requests."""
        return self


def check_picture(data: bytes, name: str, where: str) -> None:
    """Check that an image can be decoded, since trimesh silently drops a texture that it cannot decode.

    Raises:
        InvalidInputError: If the image is damaged or has too many pixels.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as opened:
                large = opened.width * opened.height > MAX_IMAGE_PIXELS
                if not large:
                    opened.load()
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        large = True
    except Exception as error:  # Pillow raises many kinds of errors for broken images
        unknown = isinstance(error, UnidentifiedImageError)  # its message contains only a memory address
        why = "its image format is not known" if unknown else one_line(error, most=120)
        problem = f"its texture {name} cannot be read ({why})"
        raise InvalidInputError(where, problem, "Save the texture as a PNG file again") from error
    if large:
        problem = f"its texture {name} has more than {MAX_IMAGE_PIXELS:,} pixels"
        raise InvalidInputError(where, problem, f"Reduce the texture to at most {LARGEST_IMAGE} pixels per side")


def read_mesh_file(path: Path, files: FolderResolver | None = None) -> RawMesh:
    """Read a mesh file.

    Args:
        path: The mesh file.
        files: Resolver that opens and records the files that the mesh file refers to. If None, a resolver for the mesh
            file's folder is created.

    Raises:
        InvalidInputError: If the file cannot be read, has no triangles, or refers to a file outside its folder.
        MissingDependencyError: If the mesh is compressed with Draco and DracoPy is not installed.
    """
    where = one_line(path.name, most=120)
    data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure="Reduce the mesh in a mesh editor")
    return read_mesh(data, path.name, files or FolderResolver(path.parent, where), where)


def read_mesh(data: bytes, name: str, files: FolderResolver, where: str) -> RawMesh:
    """Read a mesh from the content of a file.

    The extension of the file name determines the format. The function raises the same errors as :func:`read_mesh_file`.
    """
    kind = FORMATS.get(PurePosixPath(name).suffix.lower())
    if kind is None:
        raise InvalidInputError(
            where, "its format is not supported", f"Use a file in one of the formats {', '.join(FORMATS)}"
        )
    if kind in ("glb", "gltf"):
        data, kind = _readable(data, kind, files, where)
    if kind == "obj":
        data = _plain_obj(data, where)
        files = files.using(_used_materials(data))
    if kind == "stl" and _stated_triangles(data) > MAX_FACES:
        raise _too_many(where)  # check this before the surface is built, which would take gigabytes
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=files, process=False)
        parts = tuple(_parts(scene, where))
    except BetterError:
        raise
    except Exception as error:
        # any error of trimesh or Pillow about a broken file becomes one line for the user
        if files.problem is not None:
            raise files.problem from None
        raise _unreadable(error, where) from error
    if files.problem is not None:
        raise files.problem
    up, unit_m = _RULES.get(kind, (None, None))
    return checked(RawMesh(parts, up, unit_m), where)  # type: ignore[arg-type]


def _unreadable(error: Exception, where: str) -> InvalidInputError:
    problem = f"it cannot be read ({type(error).__name__}: {one_line(error, most=200)})"
    return InvalidInputError(where, problem, _CURE)


def _plain_obj(data: bytes, where: str) -> bytes:
    """Rewrite an OBJ file so that trimesh reads it correctly.

    The byte order mark and comments that trimesh would misread are removed.

    Raises:
        InvalidInputError: If a triangle refers to vertex 0, or the materials are in more than one file.
    """
    if _VERTEX_ZERO.search(data) is not None:
        raise InvalidInputError(where, "a triangle refers to vertex 0, but OBJ counts vertices from 1", _CURE)
    names = dict.fromkeys(name.strip() for name in _MATERIALS.findall(data))
    if len(names) > 1:
        first, second = (one_line(repr(name.decode(errors="replace")), most=60) for name in list(names)[:2])
        problem = f"its materials are in several files ({first}, {second}), expected one"
        raise InvalidInputError(where, problem, "Export the object with one material file, or join the material files")
    return _COMMENTED_MATERIALS.sub(b"#", data.removeprefix(codecs.BOM_UTF8))


def _used_materials(data: bytes) -> frozenset[str]:
    """Return the names of the materials that an OBJ file uses."""
    joined = data.replace(b"\\\r\n", b"").replace(b"\\\n", b"")  # a backslash at the end of a line continues the line
    return frozenset(_material_name(name.decode(errors="replace")) for name in _USED_MATERIAL.findall(joined))


def _material_name(text: str) -> str:
    return " ".join(text.split())


def _without_unused_textures(data: bytes, used: frozenset[str] | None) -> bytes:
    """Remove the textures of unused materials from an MTL file. If ``used`` is None, no texture is removed."""
    if used is None:
        return data
    kept, is_used = [], True
    for line in data.decode("utf-8", "surrogateescape").splitlines(keepends=True):
        found = _MATERIAL_LINE.match(line)
        if found is not None and found[1].lower() == "newmtl":
            name = found[2].encode("utf-8", "surrogateescape").decode(errors="replace")
            is_used = _material_name(name) in used
        if found is None or found[1].lower() == "newmtl" or is_used:
            kept.append(line)
    return "".join(kept).encode("utf-8", "surrogateescape")


def _texture_file(name: str, where: str) -> str:
    """Return the file name of a texture in an MTL file, without the options before the name.

    Raises:
        InvalidInputError: If an option scales or shifts the texture, which is not supported.
    """
    while (option := _OPTION.match(name)) is not None:
        given = [float(value) for value in option[2].split()] if option[1] in _NEUTRAL else []
        if any(value != _NEUTRAL[option[1]] for value in given):
            problem = f"the texture option {one_line(option[0].strip(), most=60)} is not supported"
            raise InvalidInputError(where, problem, "Apply it to the texture coordinates, and export the object again")
        name = name[option.end() :]
    return name


def _stated_triangles(data: bytes) -> int:
    """Return the number of triangles given in the header of a binary STL file, or 0 for any other file."""
    header = 84
    if len(data) < header:
        return 0
    count = struct.unpack("<I", data[80:header])[0]
    return int(count) if len(data) == header + 50 * count else 0


def _too_many(where: str) -> InvalidInputError:
    return InvalidInputError(where, f"it has more than {MAX_FACES:,} triangles", "Reduce the mesh in a mesh editor")


def checked(mesh: RawMesh, where: str) -> RawMesh:
    """Check a mesh and return it unchanged.

    Raises:
        InvalidInputError: If the mesh is empty, has too many triangles, or has invalid vertices or an implausible size.
    """
    if mesh.face_count == 0:
        raise InvalidInputError(where, "it contains no triangles", "Export the object as a triangle mesh")
    if mesh.face_count > MAX_FACES:
        problem = f"it has {mesh.face_count:,} triangles, expected at most {MAX_FACES:,}"
        raise InvalidInputError(where, problem, "Reduce the mesh in a mesh editor")
    for part in mesh.parts:
        if not np.isfinite(part.vertices).all():
            raise InvalidInputError(where, f"{part.name} has vertices that are not finite numbers", _CURE)
        if len(part.faces) and not (part.faces.min() >= 0 and part.faces.max() < len(part.vertices)):
            raise InvalidInputError(where, f"{part.name} has triangles that refer to missing vertices", _CURE)
    with np.errstate(over="ignore"):
        extent = np.ptp(mesh.bounds(), axis=0)
    # Outside this range, products of lengths lose precision.
    if not 1e-9 < float(extent.max()) < 1e9:
        raise InvalidInputError(
            where, f"its longest side is {float(extent.max()):.3g} units, expected between 1e-9 and 1e9", _CURE
        )
    return mesh


def _readable(data: bytes, kind: str, files: FolderResolver, where: str) -> tuple[bytes, str]:
    """Rewrite a glTF file so that trimesh does not silently drop any of its content.

    Returns:
        The content of the file and its format ("glb" or "gltf").
    """
    form = description_of(io.BytesIO(data), where, binary=kind == "glb")
    _require_readable(data, form, where)
    try:
        rewritten = plain(data, form, files.get, where)
    except BetterError:
        raise
    except Exception as error:  # the description does not have the form of glTF
        raise _unreadable(error, where) from error
    return (data, kind) if rewritten is None else (rewritten, "glb")


def _require_readable(data: bytes, form: dict[str, Any], where: str) -> None:
    """Raise an error if a glTF file has content that trimesh would silently drop."""
    _check_embedded_pictures(data, form, where)
    if _has_sparse_surface(form):
        cure = "Export the object without sparse accessors"
        raise InvalidInputError(where, "a surface has a sparse accessor, which is not supported", cure)
    asked = form.get("extensionsRequired", [])
    if not isinstance(asked, list) or not all(isinstance(name, str) for name in asked):
        raise InvalidInputError(where, "its list of extensions is not valid glTF", _CURE)
    unknown = sorted(set(asked) - _READABLE_EXTENSIONS)
    if unknown:
        cure = "Export the object without mesh compression, or with Draco"
        raise InvalidInputError(where, f"it needs the glTF extension {one_line(unknown[0], most=60)}", cure)
    if "KHR_draco_mesh_compression" in asked:
        try:
            import DracoPy  # noqa: F401, PLC0415 - trimesh uses it automatically
        except ImportError as error:
            raise missing_extra(f"{where} is compressed with Draco, which needs DracoPy", "assets") from error


def _has_sparse_surface(form: dict[str, Any]) -> bool:
    """Return whether a surface of a glTF file uses a sparse accessor. trimesh drops the values of sparse accessors."""
    try:
        sparse = {number for number, accessor in enumerate(form.get("accessors", [])) if "sparse" in accessor}
        surfaces = (
            [surface for mesh in form.get("meshes", []) for surface in mesh.get("primitives", [])] if sparse else []
        )
        return any(sparse & {surface.get("indices"), *surface.get("attributes", {}).values()} for surface in surfaces)
    except (TypeError, AttributeError):
        return False  # the description does not have the form of glTF, which the reader will report


def _check_embedded_pictures(data: bytes, form: dict[str, Any], where: str) -> None:
    """Check the images that are embedded in a glTF file, either in its binary chunk or as base64."""
    listed = form.get("images", [])
    for number, image in enumerate(listed if isinstance(listed, list) else []):
        found = _embedded(data, form, image) if isinstance(image, dict) else None
        if found is not None:
            check_picture(found, f"number {number}", where)


def _embedded(data: bytes, form: dict[str, Any], image: dict[str, Any]) -> bytes | None:
    """Return the bytes of an image embedded in a glTF file, or None if the image is a separate file.

    The result is empty if the image is damaged.
    """
    uri = image.get("uri")
    try:
        if isinstance(uri, str):
            return base64.b64decode(uri.partition(",")[2]) if uri.startswith("data:") else None
        view = form["bufferViews"][image["bufferView"]]
        start = data.index(b"BIN\0", 12 + struct.unpack("<I", data[12:16])[0]) + 4 + int(view.get("byteOffset", 0))
        return data[start : start + int(view["byteLength"])]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error):
        return b""


def _parts(scene: Any, where: str) -> list[RawPart]:  # noqa: ANN401 - a scene of trimesh
    found: list[RawPart] = []
    faces = 0
    # Node names cannot be used for sorting, because trimesh draws random ones for the primitives of a mesh.
    nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
    for transform, key in sorted(nodes, key=lambda node: (str(node[1]), np.asarray(node[0]).tolist())):
        mesh = scene.geometry[key]
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            continue
        faces += len(mesh.faces)
        if faces > MAX_FACES:
            raise _too_many(where)
        rgba, image, uv, colors = _look(mesh)
        part = RawPart(
            one_line(str(key), most=60),
            np.asarray(mesh.vertices, dtype=np.float64),
            np.asarray(mesh.faces, dtype=np.int64),
            rgba,
            image,
            uv,
            colors,
        )
        with np.errstate(all="ignore"):  # numbers that are not finite are reported later
            found.append(part.moved(np.asarray(transform, dtype=np.float64)))
    return found


def _look(mesh: Any) -> tuple[Rgba, np.ndarray | None, np.ndarray | None, np.ndarray | None]:  # noqa: ANN401
    """Return the color, the texture, the texture coordinates and the vertex colors of a mesh loaded by trimesh."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        simple = material.to_pbr() if hasattr(material, "to_pbr") else material
        factor = getattr(simple, "baseColorFactor", None)
        rgba = (1.0, 1.0, 1.0, 1.0) if factor is None else _rgba(np.asarray(factor))
        if isinstance(material, trimesh.visual.material.PBRMaterial):
            rgba = (*rgba[:3], _opacity(rgba[3], material))
        image = getattr(simple, "baseColorTexture", None)
        uv = visual.uv
        if image is None or uv is None or len(uv) != len(mesh.vertices):
            tint = _tint(mesh)
            plain_gray = factor is None and tint is None
            return ((0.8, 0.8, 0.8, 1.0) if plain_gray else rgba), None, None, tint
        if not isinstance(material, trimesh.visual.material.PBRMaterial):
            rgba = (1.0, 1.0, 1.0, rgba[3])  # OBJ exporters write a gray Kd in addition to the texture, or no Kd
        picture = image.convert("RGB")
        picture.thumbnail((LARGEST_IMAGE, LARGEST_IMAGE))
        return rgba, np.asarray(picture), np.nan_to_num(np.asarray(uv, dtype=np.float64)), _tint(mesh)
    if visual.kind in ("vertex", "face"):
        colors = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3] / 255.0
        return (1.0, 1.0, 1.0, 1.0), None, None, colors
    return (0.8, 0.8, 0.8, 1.0), None, None, None


def _opacity(alpha: float, material: Any) -> float:  # noqa: ANN401 - a material of trimesh
    """Return the opacity of a glTF material, given the alpha value of its color factor (glTF 2.0, section 3.9.4)."""
    if material.alphaMode == "BLEND":
        return alpha
    if material.alphaMode == "MASK":
        cutoff = 0.5 if material.alphaCutoff is None else float(material.alphaCutoff)
        return float(alpha >= cutoff)
    return 1.0


def _tint(mesh: Any) -> np.ndarray | None:  # noqa: ANN401 - a mesh of trimesh
    """Return the (n, 3) vertex colors in [0, 1] of a mesh from a glTF file, or None if the mesh has no vertex colors.

    glTF multiplies the color of the material by the vertex colors.
    """
    colors = np.asarray(mesh.visual.vertex_attributes.get("color", ()))
    if colors.shape[:1] != (len(mesh.vertices),) or colors.ndim != 2 or colors.shape[1] < 3:
        return None
    largest = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return np.clip(np.nan_to_num(colors[:, :3].astype(np.float64) / largest), 0.0, 1.0)


def _rgba(factor: np.ndarray) -> Rgba:
    """Convert a color factor, which trimesh stores either as bytes or as floats, to floats in [0, 1]."""
    scaled = factor.astype(np.float64) / (255.0 if factor.dtype == np.uint8 else 1.0)
    r, g, b = (float(np.clip(v, 0.0, 1.0)) for v in scaled[:3])
    return (r, g, b, float(np.clip(scaled[3], 0.0, 1.0)) if len(scaled) > 3 else 1.0)
