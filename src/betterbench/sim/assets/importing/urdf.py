"""Reader for URDF files. All links in a file are merged into one rigid body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from betterbench.errors import InvalidInputError, one_line
from betterbench.sim.assets.importing import rigid
from betterbench.sim.assets.importing.mesh_file import MAX_FACES, FolderResolver, read_mesh
from betterbench.sim.assets.importing.raw import RawMesh, RawPart, Rgba, Stated, joined
from betterbench.sim.assets.importing.rigid import PointMass, combined, numbers, pose, rotation_of_rpy

_MOVABLE = frozenset(("revolute", "continuous", "prismatic", "floating", "planar"))
_MOST_HULLS = 64
_CURE = "Correct the file, or import its mesh instead"


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray


def read_urdf(root: ET.Element, files: FolderResolver, where: str, *, freeze: bool = False) -> RawMesh:
    """Merge the links of a URDF file into one rigid body, in the frame of its root link.

    The conventions are those of the URDF specification of ROS: lengths are in meters, z is up, and ``rpy`` rotates
    about fixed axes. Meshes keep the axes of their files. ``package://NAME/PATH`` refers to PATH (or, if that does not
    exist, NAME/PATH) in the folder of the URDF file.

    Args:
        root: The ``robot`` element of the file.
        files: Resolver for the file's folder.
        where: Name of the file, for messages.
        freeze: Whether movable joints are fixed at position 0. If False, a movable joint raises an error.

    Raises:
        InvalidInputError: If the file does not describe one rigid body, or has an unsupported part.
    """
    return _Reader(root, files, where).mesh(freeze=freeze)


class _Reader:
    """State of the URDF reader while it reads one file."""

    def __init__(self, root: ET.Element, files: FolderResolver, where: str) -> None:
        self._root, self._files, self._where = root, files, where
        self._meshes: dict[str, RawMesh] = {}
        self._colors: dict[str, Rgba] = {}
        for material in root.findall("material"):
            self._colors |= self._color(material)

    def mesh(self, *, freeze: bool) -> RawMesh:
        listed = [(self._named(link, "link"), link) for link in self._root.findall("link")]
        links = dict(listed)
        if len(links) < len(listed):
            names = [name for name, _ in listed]
            twin = next(name for k, name in enumerate(names) if name in names[:k])
            raise self._wrong(f"two links have the name {twin!r}")
        shapes = sum(len(link.findall(tag)) for link in links.values() for tag in ("visual", "collision"))
        if not links:
            raise self._wrong("it has no link")
        if len(links) > rigid.MOST_BODIES or shapes > rigid.MOST_SHAPES:
            problem = f"it has {len(links)} links with {shapes} shapes"
            cure = f"Import an object of at most {rigid.MOST_BODIES} links and {rigid.MOST_SHAPES} shapes"
            raise InvalidInputError(self._where, problem, cure)
        joints = [self._joint(joint, links) for joint in self._root.findall("joint")]
        moving = [joint for joint in joints if joint.kind in _MOVABLE]
        if moving and not freeze:
            problem = f"its joint {moving[0].name!r} ({moving[0].kind}) is movable"
            raise InvalidInputError(
                self._where, problem, "Use --freeze to fix all joints at position 0, or import a single link"
            )
        poses = self._poses(links, joints)
        visual = [part for name, link in links.items() for part in self._parts(link, "visual", poses[name])]
        collision = [part for name, link in links.items() for part in self._parts(link, "collision", poses[name])]
        if not (visual or collision):
            raise self._wrong("none of its links has a shape")
        mass = combined([m for name, link in links.items() for m in self._masses(link, poses[name])])
        stated = Stated(
            hulls=tuple(_components(collision)),
            name=one_line(self._root.get("name", ""), most=60),
            notes=tuple(f"joint {joint.name!r} is fixed at 0" for joint in moving),
        )
        if mass is not None:
            stated = replace(stated, mass_kg=mass.mass_kg, center=mass.center, inertia=mass.inertia)
        return RawMesh(tuple(visual or collision), "z", 1.0, stated)

    def _wrong(self, problem: str) -> InvalidInputError:
        return InvalidInputError(self._where, problem, _CURE)

    def _named(self, element: ET.Element, what: str) -> str:
        name = element.get("name", "")
        if not name:
            raise self._wrong(f"a {what} has no name")
        return one_line(name, most=60)

    def _joint(self, element: ET.Element, links: Mapping[str, ET.Element]) -> _Joint:
        name, kind = self._named(element, "joint"), element.get("type", "")
        if kind not in _MOVABLE and kind != "fixed":
            raise self._wrong(f"its joint {name!r} has the type {one_line(repr(kind), most=40)}")
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            link = "" if end is None else one_line(end.get("link", ""), most=60)
            if link not in links:
                raise self._wrong(f"the {tag} of its joint {name!r} is {link!r}, which is not a link")
            ends.append(link)
        return _Joint(name, kind, ends[0], ends[1], self._origin(element))

    def _poses(self, links: Mapping[str, ET.Element], joints: list[_Joint]) -> dict[str, np.ndarray]:
        """Return the (4, 4) pose of each link in the frame of the root link."""
        above = {joint.child: joint for joint in joints}
        if len(above) < len(joints):
            raise self._wrong("a link has two parents")
        roots = [name for name in links if name not in above]
        if len(roots) != 1:
            found = (
                "its joints form a closed loop"
                if not roots
                else (f"its links {roots[0]!r} and {roots[1]!r} are not connected by a joint")
            )
            raise self._wrong(found)
        poses = {roots[0]: np.eye(4)}
        for name in links:
            chain: list[_Joint] = []
            while name not in poses:
                chain.append(above[name])
                if len(chain) > len(links):
                    raise self._wrong("its joints form a closed loop")
                name = above[name].parent  # noqa: PLW2901 - the way up
            for joint in reversed(chain):
                poses[joint.child] = poses[joint.parent] @ joint.origin
        return poses

    def _origin(self, element: ET.Element) -> np.ndarray:
        origin = element.find("origin")
        if origin is None:
            return np.eye(4)
        xyz = numbers(origin.get("xyz", "0 0 0"), 3, self._where, "origin xyz")
        return pose(xyz, rotation_of_rpy(numbers(origin.get("rpy", "0 0 0"), 3, self._where, "origin rpy")))

    def _number(self, element: ET.Element, name: str) -> float:
        value = float(numbers(element.get(name, ""), 1, self._where, f"{element.tag} {name}")[0])
        if value <= 0.0:
            raise self._wrong(f"{element.tag} {name} is {value:g}, expected more than 0")
        return value

    def _masses(self, link: ET.Element, at: np.ndarray) -> Iterator[PointMass]:
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            return
        value = float(numbers(mass.get("value", ""), 1, self._where, "mass value")[0])
        if value < 0.0:
            raise self._wrong(f"mass value is {value:g}, expected at least 0")
        place = at @ self._origin(inertial)
        form = inertial.find("inertia")
        tensor = np.zeros((3, 3))
        if form is not None:
            for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
                field = f"i{'xyz'[i]}{'xyz'[j]}"
                tensor[i, j] = tensor[j, i] = numbers(form.get(field, "0"), 1, self._where, f"inertia {field}")[0]
        turn = place[:3, :3]
        yield PointMass(value, place[:3, 3], turn @ tensor @ turn.T)

    def _parts(self, link: ET.Element, tag: str, at: np.ndarray) -> Iterator[RawPart]:
        for shape in link.findall(tag):
            geometry = shape.find("geometry")
            forms = [] if geometry is None else list(geometry)
            if len(forms) != 1:
                raise self._wrong(f"a {tag} of link {self._named(link, 'link')!r} does not have exactly one geometry")
            color = self._color_of(shape)
            for part in self._geometry(forms[0]):
                moved = part.moved(at @ self._origin(shape))
                yield moved if color is None else replace(moved, rgba=color)

    def _geometry(self, form: ET.Element) -> tuple[RawPart, ...]:
        if form.tag == "mesh":
            return self._mesh(form)
        if form.tag == "box":
            size = numbers(form.get("size", ""), 3, self._where, "box size")
            if size.min() <= 0.0:
                raise self._wrong("box size has a side that is not positive")
            made = rigid.box(0.5 * size)
        elif form.tag == "sphere":
            made = rigid.ellipsoid(np.full(3, self._number(form, "radius")))
        elif form.tag in ("cylinder", "capsule"):
            make = rigid.cylinder if form.tag == "cylinder" else rigid.capsule
            made = make(self._number(form, "radius"), 0.5 * self._number(form, "length"))
        else:
            raise self._wrong(f"the geometry type {one_line(repr(form.tag), most=40)} is not supported")
        return (RawPart(form.tag, *made),)

    def _mesh(self, form: ET.Element) -> tuple[RawPart, ...]:
        name = form.get("filename", "")
        if name not in self._meshes:
            inside = self._inside(name)
            data = self._files.get(inside)
            shown = f"{self._where}: {one_line(PurePosixPath(inside).name, most=80)}"
            self._meshes[name] = read_mesh(data, inside, self._files.below(inside, shown), shown)
            if sum(mesh.face_count for mesh in self._meshes.values()) > MAX_FACES:
                raise self._wrong(f"its meshes have more than {MAX_FACES:,} triangles")
        scale = numbers(form.get("scale", "1 1 1"), 3, self._where, "mesh scale")
        if not scale.all():
            raise self._wrong("mesh scale has a factor of 0")
        return self._meshes[name].moved(np.diag([*scale, 1.0])).parts

    def _inside(self, name: str) -> str:
        """Convert a file name in the URDF file to a path relative to the folder of the URDF file."""
        scheme, separator, rest = name.partition("://")
        if not separator:
            return name
        if scheme != "package":
            raise self._wrong(f"it refers to {one_line(repr(name), most=120)}, which is not a file in its folder")
        below = rest.partition("/")[2]
        return rest if not self._files.holds(below) and self._files.holds(rest) else below

    def _color(self, material: ET.Element) -> dict[str, Rgba]:
        form = material.find("color")
        if form is None:
            return {}
        r, g, b, a = (float(v) for v in np.clip(numbers(form.get("rgba", ""), 4, self._where, "color rgba"), 0.0, 1.0))
        return {material.get("name", ""): (r, g, b, a)}

    def _color_of(self, shape: ET.Element) -> Rgba | None:
        material = shape.find("material")
        if material is None:
            return None
        own = self._color(material)
        self._colors |= own  # a material that is defined once can be used in the whole file
        return next(iter(own.values()), self._colors.get(material.get("name", "")))


def _components(parts: list[RawPart]) -> Iterator[np.ndarray]:
    """Yield the points of each connected piece of the collision shapes.

    A file may store several convex pieces as one mesh.
    """
    for part in parts:
        points, faces = joined([part])
        if len(faces) == 0:
            continue
        rows = np.concatenate([faces[:, 0], faces[:, 1]])
        columns = np.concatenate([faces[:, 1], faces[:, 2]])
        links = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(len(points), len(points)))
        count, label = connected_components(links, directed=False)
        if count > _MOST_HULLS:
            yield points
            continue
        used = np.zeros(len(points), bool)
        used[faces.ravel()] = True
        yield from (points[(label == k) & used] for k in range(count) if ((label == k) & used).sum() > 3)
