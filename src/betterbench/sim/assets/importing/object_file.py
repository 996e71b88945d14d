"""Reader for files that contain one object: a mesh, or a rigid body in a URDF or MJCF file."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import read_bounded
from betterbench.sim.assets.importing.mesh_file import FORMATS as MESH_FORMATS
from betterbench.sim.assets.importing.mesh_file import FolderResolver, checked, read_mesh_file
from betterbench.sim.assets.importing.raw import RawMesh
from betterbench.sim.assets.importing.urdf import read_urdf
from betterbench.sim.assets.xml_file import MAX_XML_BYTES, parse_xml

XML_FORMATS = (".urdf", ".xml", ".mjcf")
FORMATS = (*MESH_FORMATS, *XML_FORMATS)
"""Supported file extensions."""

_REFUSED = ("plugin", "extension", "include")


def read_object(path: Path, files: FolderResolver, *, freeze: bool = False) -> RawMesh:
    """Read the object in a file.

    Args:
        path: The mesh, URDF or MJCF file.
        files: Resolver for the file's folder, which records the files that are read.
        freeze: Whether movable joints of a URDF or MJCF file are fixed in place. If False, a movable joint raises an
            error.

    Raises:
        InvalidInputError: If the file cannot be read, does not contain one rigid object, or refers to a file outside
            its folder.
        MissingDependencyError: If the mesh is compressed with Draco and DracoPy is not installed.
    """
    if path.suffix.lower() not in XML_FORMATS:
        return read_mesh_file(path, files)
    where = one_line(path.name, most=120)
    root = parse_xml(read_bounded(path, max_bytes=MAX_XML_BYTES, cure="Store meshes in separate files"), where)
    if root.tag not in ("robot", "mujoco"):
        problem = f"its first element is {one_line(repr(root.tag), most=60)}, expected robot (URDF) or mujoco (MJCF)"
        raise InvalidInputError(where, problem, "Use a URDF or MJCF file")
    _require_plain(root, where)
    if root.tag == "robot":
        return checked(read_urdf(root, files, where, freeze=freeze), where)
    from betterbench.sim.assets.importing.mjcf import read_mjcf  # noqa: PLC0415 - it loads MuJoCo

    return checked(read_mjcf(root, files, where, freeze=freeze), where)


def _require_plain(root: ET.Element, where: str) -> None:
    """Raise an error if a URDF or MJCF file has macros, or elements that would load code or further files."""
    for element in root.iter():
        tag = element.tag
        if tag in _REFUSED:
            problem = f"it has the element {tag}, which would load code or another file"
            raise InvalidInputError(where, problem, f"Remove the element {tag}, which a passive object does not need")
        if ":" in tag:
            problem = f"it has the macro {one_line(tag, most=60)}"
            raise InvalidInputError(where, problem, "Expand it first with `xacro FILE > object.urdf`")
