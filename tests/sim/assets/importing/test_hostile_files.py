"""Hostile files: one clear error each, within limits of time and memory, and nothing is left behind.

Each file is imported as a user would import it: by the job that writes a folder of assets. Files with millions of
triangles are imported in its limited process; files whose errors come before anything large is read need no such
process, and are tested without it, because each start takes seconds.
"""

from __future__ import annotations

import base64
import builtins
import contextlib
import functools
import json
import os
import resource
import struct
import zlib

import numpy as np
import pytest
from tests.daily import in_turn

from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.sim.assets.folders.job import ImportRequest, import_assets
from betterbench.sim.assets.importing import child, mesh_file
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.mesh_file import FolderResolver, read_mesh_file
from betterbench.sim.assets.importing.object_file import read_object

PARENT_MB = 300
"""Most memory that the importing process itself may take for one of these files."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "secret.txt").write_text("newmtl m\nKd 1 0 0\n")
    (tmp_path / "files").mkdir()
    return tmp_path / "files"


def refused(folder, name, text, **wishes):
    """Import a file that must fail with one line, and check that it leaves nothing."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said = Wishes(**{"name": "mug", "license": "CC0-1.0", **wishes})
    report = import_assets([ImportRequest(path=folder / name, wishes=said)], folder.parent / "mine")
    assert report.made == []
    ((file, problem),) = report.failed
    assert file == name
    assert text in problem, problem
    assert "\n" not in problem
    assert not list((folder.parent / "mine").rglob("*.npz"))
    cache = folder.parent / "cache"
    assert not [path for path in cache.rglob("*") if path.is_file()]
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10 < PARENT_MB


def glb(form, binary=b""):
    text = json.dumps(form).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        binary += b"\0" * (-len(binary) % 4)
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def triangle_form(points, **more):
    """Return a glTF description of one triangle with its bytes, and further fields."""
    binary = np.asarray(points, "<f4").tobytes()
    form = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(binary)}],
        "buffers": [{"byteLength": len(binary)}],
    }
    return {**form, **more}, binary


CORNERS = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0.1)]
TRIANGLE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nf 1 2 3\n"


@functools.cache
def png(width, height):
    """Return a black PNG file of one bit per pixel, which is small however large the picture is."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes(height * (1 + -(-width // 8))))
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


# ------------------------------------------------------------------------------------------------- references and paths


@pytest.mark.parametrize(
    "name", ["../secret.txt", "/etc/passwd", "http://host/m.mtl", "..\\secret.txt", "%2e%2e/secret.txt"]
)
def test_a_material_file_outside_the_folder_is_not_read(folder, name):
    (folder / "a.obj").write_text(f"mtllib {name}\nusemtl m\n{TRIANGLE}")
    with pytest.raises(InvalidInputError, match=r"outside its folder|does not exist"):
        read_mesh_file(folder / "a.obj")


@pytest.mark.usefixtures("imports_here")
def test_a_texture_of_a_material_outside_the_folder_is_not_read(folder):
    (folder.parent / "secret.png").write_bytes(png(4, 4))
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd ../secret.png\n")
    (folder / "a.obj").write_text("mtllib a.mtl\nusemtl m\nvt 0 0\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nf 1/1 2/1 3/1\n")
    refused(folder, "a.obj", "outside its folder")


@pytest.mark.parametrize("where", ["buffers", "images"])
@pytest.mark.parametrize("uri", ["../secret.bin", "/etc/passwd", "file:///etc/passwd", "http://host/x.bin"])
def test_a_gltf_reference_outside_the_folder_is_not_read(folder, where, uri):
    form, binary = triangle_form(CORNERS)
    (folder.parent / "secret.bin").write_bytes(binary)
    if where == "buffers":
        form["buffers"][0]["uri"] = uri
    else:
        (folder / "own.bin").write_bytes(binary)
        form["buffers"][0]["uri"] = "own.bin"
        form |= {
            "images": [{"uri": uri}],
            "textures": [{"source": 0}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        }
        form["meshes"][0]["primitives"][0]["material"] = 0
    (folder / "a.gltf").write_text(json.dumps(form))
    with pytest.raises(InvalidInputError, match="outside its folder") as caught:
        read_mesh_file(folder / "a.gltf")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", ["../part.stl", "/etc/part.stl", "package://other/../../part.stl", "file:///etc/part.stl", "linked.stl"]
)
@pytest.mark.parametrize("kind", ["urdf", "xml"])
def test_a_mesh_of_a_prop_outside_the_folder_is_not_read(folder, name, kind):
    (folder.parent / "part.stl").write_bytes(b"solid")
    (folder / "linked.stl").symlink_to(folder.parent / "part.stl")
    link = f'<link name="a"><visual><geometry><mesh filename="{name}"/></geometry></visual></link>'
    body = '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody>'
    texts = {
        "urdf": f'<robot name="r">{link}</robot>',
        "xml": f'<mujoco><asset><mesh name="m" file="{name}"/></asset>{body}</mujoco>',
    }
    path = folder / f"a.{kind}"
    path.write_text(texts[kind])
    with pytest.raises(InvalidInputError, match=r"outside its folder|not a file in its folder"):
        read_object(path, FolderResolver(folder, path.name))


@pytest.mark.usefixtures("imports_here")
@pytest.mark.parametrize("attribute", ["meshdir", "assetdir"])
def test_a_mesh_folder_outside_the_folder_is_not_read(folder, attribute):
    (folder.parent / "part.stl").write_bytes(b"solid")
    text = f'<mujoco><compiler {attribute}=".."/><asset><mesh name="m" file="part.stl"/></asset>'
    (folder / "a.xml").write_text(text + '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody></mujoco>')
    refused(folder, "a.xml", "outside its folder")


# --------------------------------------------------------------------------------------------------------------- XML

BOMB = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))


@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize(
    "head",
    [
        f'<!DOCTYPE robot [<!ENTITY l0 "lol">{BOMB}]>',
        '<!DOCTYPE robot [<!ENTITY secret SYSTEM "../secret.txt">]>',
        '<!DOCTYPE robot SYSTEM "http://host/x.dtd">',
    ],
)
def test_entities_of_xml_are_refused(folder, kind, head):
    path = folder / f"a.{kind}"
    for encoding in ("utf-8", "utf-16"):
        path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{head}<robot name="x"/>'.encode(encoding))
        with pytest.raises(InvalidInputError, match="document type or entities"):
            read_object(path, FolderResolver(folder, path.name))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<mujoco><extension><plugin plugin="mujoco.sdf.torus"/></extension></mujoco>', "element extension"),
        ('<mujoco><worldbody><body><geom><plugin plugin="x"/></geom></body></worldbody></mujoco>', "element plugin"),
        ('<mujoco><include file="/etc/passwd"/></mujoco>', "element include"),
        ('<robot name="r"><gazebo><plugin filename="lib.so" name="p"/></gazebo></robot>', "element plugin"),
        ('<robot name="r">' + "<link>" * 5_000, "nested deeper"),
        ('<robot name="r">' + '<link name="a"/>' * 30_000 + "</robot>", "more than 20,000 elements"),
        ('<robot name="r"><link name="a">', "is not XML"),
    ],
)
def test_elements_that_load_code_and_huge_documents_are_refused(folder, text, said):
    path = folder / ("a.urdf" if "robot" in text else "a.xml")
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=said):
        read_object(path, FolderResolver(folder, path.name))


# ------------------------------------------------------------------------------------------ sizes, numbers, compression


@pytest.mark.usefixtures("imports_here")
@pytest.mark.parametrize(
    ("count", "most", "said"),
    [
        (10_000_000, 2_000_000, "has 476 MB, expected at most 256"),
        (2_100, 2_000, "more than 2,000 triangles"),
    ],
)
def test_too_many_triangles_are_refused_before_a_surface_is_made_of_them(folder, monkeypatch, count, most, said):
    monkeypatch.setattr(mesh_file, "MAX_FACES", most)
    monkeypatch.delattr("trimesh.load_scene")
    with (folder / "a.stl").open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", count))
        file.truncate(84 + 50 * count)  # sparse: it takes no disk
    refused(folder, "a.stl", said)


def test_a_text_with_millions_of_triangles_is_refused(folder, monkeypatch):
    monkeypatch.setattr(mesh_file, "MAX_FACES", 1_000)
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 1\n" + "f 1 2 3\n" * 2_000)
    with pytest.raises(InvalidInputError, match="more than 1,000 triangles"):
        read_mesh_file(folder / "a.obj")


@pytest.mark.usefixtures("imports_here")
def test_vertices_that_are_not_numbers_are_refused(folder):
    form, binary = triangle_form([(0, 0, 0), (np.nan, 0, 0), (0, np.inf, 0.1)])
    (folder / "a.glb").write_bytes(glb(form, binary))
    refused(folder, "a.glb", "not finite numbers")


def test_a_file_that_is_cut_off_is_refused_wherever_it_ends(folder):
    form, binary = triangle_form(CORNERS)
    whole = glb(form, binary)
    for end in (3, 12, 19, 40, len(whole) - len(binary) - 4, len(whole) - 1):
        (folder / "a.glb").write_bytes(whole[:end])
        with pytest.raises(InvalidInputError) as caught:
            read_mesh_file(folder / "a.glb")
        assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("imports_here")
def test_an_accessor_that_promises_gigabytes_is_refused(folder):
    form, binary = triangle_form(CORNERS)
    form["accessors"][0]["count"] = 2_000_000_000
    (folder / "a.glb").write_bytes(glb(form, binary))
    refused(folder, "a.glb", "cannot be read")


def test_a_sparse_accessor_of_a_surface_is_refused(folder):
    """The reader of glTF drops the replaced values, which gives another shape."""
    form, binary = triangle_form(CORNERS)
    sparse = {"count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}
    form["accessors"].append({**form["accessors"][0], "sparse": sparse})
    (folder / "a.glb").write_bytes(glb(form, binary))
    assert read_mesh_file(folder / "a.glb").face_count == 1, "no surface uses the accessor"
    form["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 1
    (folder / "a.glb").write_bytes(glb(form, binary))
    with pytest.raises(InvalidInputError, match="sparse accessor"):
        read_mesh_file(folder / "a.glb")


@pytest.mark.parametrize("face", ["f 0 1 2", "f 1 2 0", "f 1/1 0/2 3/3", "f 1 2 3 0"])
def test_a_triangle_of_vertex_zero_is_refused(folder, face):
    """Vertices of OBJ are counted from 1, and a reader that takes 0 for the last vertex gives another shape."""
    (folder / "a.obj").write_text(f"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nv 0.1 0.1 0\nvt 0 0\nvt 1 0\nvt 0 1\n{face}\n")
    with pytest.raises(InvalidInputError, match="vertex 0"):
        read_mesh_file(folder / "a.obj")
    (folder / "a.obj").write_text(f"o box 0 0\n# f 0 1 2\n{TRIANGLE}f 10 20 30\n".replace("f 10 20 30\n", ""))
    assert read_mesh_file(folder / "a.obj").face_count == 1


def test_two_links_with_one_name_are_refused(folder):
    shape = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    (folder / "a.urdf").write_text(f'<robot name="r"><link name="a">{shape}</link><link name="a"/></robot>')
    with pytest.raises(InvalidInputError, match="two links have the name 'a'"):
        read_object(folder / "a.urdf", FolderResolver(folder, "a.urdf"))


@pytest.mark.parametrize("size", ['nkey="1000000000"', 'memory="900G"', 'nuserdata="2000000000"', 'njmax="100"'])
def test_the_memory_that_a_prop_asks_for_is_not_reserved(folder, size):
    """A prop needs none, and MuJoCo spends minutes on a billion of key frames."""
    body = '<worldbody><body><geom type="box" size="0.1 0.1 0.1"/></body></worldbody>'
    (folder / "a.xml").write_text(f"<mujoco><size {size}/>{body}</mujoco>")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert read_object(folder / "a.xml", FolderResolver(folder, "a.xml")).face_count == 12
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10 < PARENT_MB


def test_draco_without_its_decoder_is_named_with_the_cure(folder, monkeypatch):
    draco = "KHR_draco_mesh_compression"
    form, binary = triangle_form(CORNERS, extensionsRequired=[draco], extensionsUsed=[draco])
    (folder / "a.glb").write_bytes(glb(form, binary))
    real = builtins.__import__

    def without(name, *given, **more):
        if name == "DracoPy":
            raise ImportError(name)
        return real(name, *given, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingDependencyError, match="compressed with Draco, which needs DracoPy"):
        read_mesh_file(folder / "a.glb")


@pytest.mark.usefixtures("imports_here")
@pytest.mark.parametrize("kind", ["mtl", "mjcf"])
def test_a_picture_of_gigabytes_is_refused_before_it_is_unpacked(folder, kind):
    """A small PNG file whose picture has 81 million pixels: a zip bomb."""
    bomb = png(9_000, 9_000)
    assert len(bomb) < 2 << 20
    (folder / "skin.png").write_bytes(bomb)
    if kind == "mtl":
        (folder / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
        (folder / "a.obj").write_text(
            "mtllib a.mtl\nusemtl m\nvt 0 0\nvt 1 0\nvt 0 1\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nf 1/1 2/2 3/3\n"
        )
        refused(folder, "a.obj", "pixels")
        return
    (folder / "part.obj").write_text(TRIANGLE)
    asset = '<mesh name="m" file="part.obj"/><texture name="t" type="2d" file="skin.png"/>'
    body = '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody>'
    (folder / "a.xml").write_text(f"<mujoco><asset>{asset}</asset>{body}</mujoco>")
    refused(folder, "a.xml", "pixels")


@pytest.mark.parametrize("kind", ["chunk", "base64"])
@pytest.mark.parametrize("what", ["huge", "cut off", "nothing"])
def test_a_picture_inside_a_gltf_file_is_checked_too(folder, kind, what):
    picture = {"huge": png(9_000, 9_000), "cut off": png(64, 64)[:-40], "nothing": b"GIF"}[what]
    form, binary = triangle_form(CORNERS)
    if kind == "chunk":
        form["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(picture)})
        form["images"] = [{"bufferView": 1, "mimeType": "image/png"}]
        form["buffers"][0]["byteLength"] = len(binary) + len(picture)
        binary += picture
    else:
        form["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(picture).decode()}]
    (folder / "a.glb").write_bytes(glb(form, binary))
    with pytest.raises(InvalidInputError, match="its texture number 0"):
        read_mesh_file(folder / "a.glb")


@in_turn(1, 2)  # the other one is in test_importing.py
def test_a_process_that_takes_too_much_memory_is_told_so(folder, monkeypatch):
    """The limited process holds its limits whatever a file does: 1 GB of address space is too little for any mesh."""
    monkeypatch.setattr(child, "MAX_MEMORY_BYTES", 1 << 30)
    (folder / "a.obj").write_text(TRIANGLE)
    with pytest.raises(InvalidInputError) as caught:
        child.import_bytes(folder / "a.obj", Wishes("mug"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.glb", "a.obj", "a.stl", "a.ply", "a.urdf", "a.xml"])
def test_a_pipe_or_a_folder_is_no_file(folder, name):
    os.mkfifo(folder / name)
    with pytest.raises(InvalidInputError):
        read_object(folder / name, FolderResolver(folder, name))


def test_random_changes_of_a_file_never_end_in_another_error(folder):
    form, binary = triangle_form(CORNERS)
    whole = np.frombuffer(glb(form, binary), np.uint8)
    draw = np.random.default_rng(7)
    for _ in range(60):
        changed = whole.copy()
        at = draw.integers(12, len(whole), 4)
        changed[at] = draw.integers(0, 256, 4)
        (folder / "a.glb").write_bytes(changed.tobytes())
        with contextlib.suppress(InvalidInputError):
            read_mesh_file(folder / "a.glb")
