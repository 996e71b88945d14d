"""Legal files that common readers get wrong: each is read as the format says, or is one clear error."""

from __future__ import annotations

import contextlib
import io
import json
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.importing.mesh_file import FolderResolver, read_mesh_file
from betterbench.sim.assets.importing.object_file import read_object

BOX = trimesh.creation.box((0.06, 0.04, 0.1))
CORNERS = np.asarray(BOX.vertices, dtype="<f4")
FACES = np.asarray(BOX.faces, dtype="<u4").reshape(-1, 1)
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def size_of(mesh):
    return np.round(np.ptp(mesh.bounds(), axis=0), 4).tolist()


def color_of(mesh):
    """Return the mean color of the first part."""
    part = mesh.parts[0]
    found = part.colors_at(np.arange(len(part.faces)), np.full((len(part.faces), 3), 1 / 3))
    return tuple(np.round(found.mean(axis=0), 2).tolist())


def picture():
    """Return a PNG file: red on the left, blue on the right."""
    pixels = np.zeros((4, 8, 3), np.uint8)
    pixels[:, :4], pixels[:, 4:] = (255, 0, 0), (0, 0, 255)
    written = io.BytesIO()
    Image.fromarray(pixels).save(written, "PNG")
    return written.getvalue()


# ---------------------------------------------------------------------------------------------------------------- glTF


class Gltf:
    """A GLB file with one box, to be changed by a test."""

    def __init__(self):
        self.binary = b""
        self.form = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "accessors": []}
        self.form |= {"bufferViews": [], "nodes": [{"mesh": 0}]}
        self.surface = {"attributes": {"POSITION": self.values(CORNERS, "VEC3")}}
        self.surface["indices"] = self.values(FACES, "SCALAR")
        self.form["meshes"] = [{"primitives": [self.surface]}]

    def view(self, raw, **more):
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(raw), **more}
        self.form["bufferViews"].append(view)
        self.binary += raw
        return len(self.form["bufferViews"]) - 1

    def values(self, array, kind, *, view=None, **more):
        types = {"<f4": 5126, "<u4": 5125, "<i2": 5122, "|u1": 5121}
        accessor = {"bufferView": self.view(array.tobytes()) if view is None else view, "count": len(array)}
        self.form["accessors"].append({**accessor, "componentType": types[array.dtype.str], "type": kind, **more})
        return len(self.form["accessors"]) - 1

    def attribute(self, name, row, kind, **more):
        """Give each corner the same values."""
        self.surface["attributes"][name] = self.values(np.tile(row, (len(CORNERS), 1)), kind, **more)

    def textured(self, u, **texture):
        self.attribute("TEXCOORD_0", np.array([[u, 0.5]], "<f4"), "VEC2")
        self.form["images"] = [{"bufferView": self.view(picture()), "mimeType": "image/png"}]
        self.form["textures"] = [{"source": 0}]
        self.form["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}}}]
        self.surface["material"] = 0

    def skinned(self, *poses):
        """Bind the box to joints with given poses; the node of the box has another pose, which does not count."""
        self.attribute("JOINTS_0", np.array([[0, 0, 0, 0]], "|u1"), "VEC4")
        self.attribute("WEIGHTS_0", np.array([[1, 0, 0, 0]], "<f4"), "VEC4")
        self.form["nodes"] += poses
        joints = list(range(1, len(poses) + 1))
        self.form["scenes"][0]["nodes"] += joints
        bound = np.tile(np.eye(4, dtype="<f4").reshape(1, 16), (len(poses), 1))
        self.form["skins"] = [{"joints": joints, "inverseBindMatrices": self.values(bound, "MAT4")}]
        self.form["nodes"][0] |= {"skin": 0, "scale": [0.01, 0.01, 0.01]}

    def data(self):
        form = {**self.form, "buffers": [{"byteLength": len(self.binary)}]}
        text = json.dumps(form).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + bytes(-len(self.binary) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
        return (
            head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
        )

    def read(self, folder):
        (folder / "a.glb").write_bytes(self.data())
        return read_mesh_file(folder / "a.glb")


@pytest.fixture
def gltf():
    return Gltf()


def test_a_skin_in_its_rest_pose_has_the_pose_of_its_joints(gltf, tmp_path):
    """Exporters of figures write the scale of the skeleton into its joints, and readers that drop skins miss it."""
    gltf.skinned({"scale": [2, 2, 2], "translation": [0, 0, 0.5]}, {"scale": [2, 2, 2], "translation": [0, 0, 0.5]})
    mesh = gltf.read(tmp_path)
    assert size_of(mesh) == [0.12, 0.08, 0.2]
    assert mesh.bounds()[0][2] == pytest.approx(0.4)


def test_joints_below_turned_nodes_pose_a_skin(gltf, tmp_path):
    half = np.sqrt(0.5)
    gltf.skinned({"translation": [0.0, 0.0, 0.0]})
    gltf.form["nodes"].append({"children": [1], "rotation": [half, 0, 0, half], "scale": [1, 1, 3]})
    gltf.form["scenes"][0]["nodes"] = [0, 2]
    assert size_of(gltf.read(tmp_path)) == [0.06, 0.3, 0.04]


def test_a_posed_skeleton_is_refused(gltf, tmp_path):
    gltf.skinned({}, {"translation": [0.02, 0, 0]})
    with pytest.raises(InvalidInputError, match=r"its skeleton.*Apply the armature"):
        gltf.read(tmp_path)


@pytest.mark.parametrize("where", ["meshes", "nodes"])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_shape_keys_that_are_in_use_are_refused(gltf, tmp_path, where, weight):
    gltf.surface["targets"] = [{"POSITION": gltf.values(CORNERS, "VEC3")}]
    gltf.form[where][0]["weights"] = [weight]
    if weight == 0.0:
        assert size_of(gltf.read(tmp_path)) == [0.06, 0.04, 0.1]
        return
    with pytest.raises(InvalidInputError, match=r"shape keys.*not at 0"):
        gltf.read(tmp_path)


def test_instances_are_refused(gltf, tmp_path):
    gltf.form["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {}}}
    with pytest.raises(InvalidInputError, match=r"instances.*real objects"):
        gltf.read(tmp_path)


@pytest.mark.parametrize("normalized", [True, False])
def test_quantized_positions_are_read(gltf, tmp_path, normalized):
    scale = 32767 if normalized else 16000
    rows = np.zeros((len(CORNERS), 4), "<i2")
    rows[:, :3] = np.round(CORNERS / 0.1 * scale)
    view = gltf.view(rows.tobytes(), byteStride=8)
    more = {"normalized": True} if normalized else {}
    gltf.surface["attributes"]["POSITION"] = gltf.values(rows, "VEC3", view=view, **more)
    gltf.form["extensionsRequired"] = ["KHR_mesh_quantization"]
    gltf.form["nodes"][0]["scale"] = [0.1 if normalized else 0.1 / scale] * 3
    assert size_of(gltf.read(tmp_path)) == [0.06, 0.04, 0.1]


def test_a_fan_is_a_surface(gltf, tmp_path):
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.02], [0, 0.1, 0]], "<f4")
    gltf.surface = {"attributes": {"POSITION": gltf.values(corners, "VEC3")}, "mode": 6}
    gltf.form["meshes"][0]["primitives"].append(gltf.surface)
    assert gltf.read(tmp_path).face_count == 12 + 2


def test_a_file_without_a_scene_shows_its_root_nodes(gltf, tmp_path):
    del gltf.form["scene"], gltf.form["scenes"]
    gltf.form["nodes"].append({"children": [0], "scale": [2, 2, 2]})
    assert size_of(gltf.read(tmp_path)) == [0.12, 0.08, 0.2]


@pytest.mark.parametrize(
    ("texture", "color"),
    [
        ({}, RED),
        ({"extensions": {"KHR_texture_transform": {"offset": [0.5, 0.0]}}}, BLUE),
        ({"extensions": {"KHR_texture_transform": {"scale": [3.0, 1.0]}}}, BLUE),
        ({"extensions": {"KHR_texture_transform": {"rotation": np.pi, "offset": [0.9, 1.0]}}}, BLUE),
        ({"texCoord": 1}, BLUE),
        ({"extensions": {"KHR_texture_transform": {"texCoord": 1}}}, BLUE),
    ],
)
def test_textures_are_read_at_the_coordinates_of_the_format(gltf, tmp_path, texture, color):
    gltf.textured(0.25, **texture)
    gltf.attribute("TEXCOORD_1", np.array([[0.75, 0.5]], "<f4"), "VEC2")
    gltf.form["extensionsUsed"] = ["KHR_texture_transform"]
    assert color_of(gltf.read(tmp_path)) == color


def test_an_image_of_an_unknown_format_is_named_without_an_address_in_memory(gltf, tmp_path):
    gltf.form["images"] = [{"bufferView": gltf.view(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(60))}]
    with pytest.raises(InvalidInputError, match=r"texture number 0 cannot be read \(its image format is not known\)"):
        gltf.read(tmp_path)


def test_colors_of_corners_multiply_the_material(gltf, tmp_path):
    gltf.attribute("COLOR_0", np.array([[0, 255, 255, 255]], "|u1"), "VEC4", normalized=True)
    gltf.form["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.2, 1, 1]}}]
    gltf.surface["material"] = 0
    assert color_of(gltf.read(tmp_path)) == (0.0, 0.2, 1.0)


@pytest.mark.parametrize(
    ("mode", "alpha"),
    [
        ({}, 1.0),
        ({"alphaMode": "OPAQUE"}, 1.0),
        ({"alphaMode": "BLEND"}, 0.2),
        ({"alphaMode": "MASK"}, 0.0),
        ({"alphaMode": "MASK", "alphaCutoff": 0.1}, 1.0),
    ],
)
@pytest.mark.parametrize("textured", [False, True])
def test_opacity_counts_only_in_the_mode_of_the_material(gltf, tmp_path, mode, alpha, textured):
    gltf.textured(0.25)
    look = {"baseColorFactor": [1, 1, 1, 0.2]} | ({"baseColorTexture": {"index": 0}} if textured else {})
    gltf.form["materials"] = [{"pbrMetallicRoughness": look, **mode}]
    assert gltf.read(tmp_path).parts[0].rgba[3] == pytest.approx(alpha, abs=0.01)


GLOSS = "KHR_materials_pbrSpecularGlossiness"


@pytest.mark.parametrize(
    ("gloss", "color"),
    [
        ({"diffuseFactor": [1, 0, 0, 1]}, RED),
        ({"diffuseTexture": {"index": 0}}, RED),
        ({"diffuseTexture": {"index": 0}, "diffuseFactor": [0.5, 1, 1, 1]}, (0.5, 0.0, 0.0)),
        ({}, (1.0, 1.0, 1.0)),
    ],
)
def test_the_color_of_a_glossy_material_replaces_that_of_a_metallic_one(gltf, tmp_path, gloss, color):
    gltf.textured(0.25)
    plain = {"baseColorFactor": [0, 0, 1, 1]}
    gltf.form["materials"] = [{"pbrMetallicRoughness": plain, "extensions": {GLOSS: gloss}}]
    gltf.form["extensionsUsed"] = [GLOSS]
    assert color_of(gltf.read(tmp_path)) == color


def test_a_texture_that_is_webp_is_read(gltf, tmp_path):
    gltf.textured(0.25)
    written = io.BytesIO()
    Image.new("RGB", (8, 8), (0, 0, 255)).save(written, "WEBP", lossless=True)
    name = "EXT_texture_webp"
    gltf.form["images"] = [{"bufferView": gltf.view(written.getvalue()), "mimeType": "image/webp"}]
    gltf.form["textures"] = [{"extensions": {name: {"source": 0}}}]
    gltf.form |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    assert color_of(gltf.read(tmp_path)) == BLUE


def test_a_plain_file_is_not_rewritten(gltf, tmp_path, monkeypatch):
    monkeypatch.setattr("betterbench.sim.assets.importing.plain_gltf._Document.glb", lambda _: pytest.fail("rewritten"))
    gltf.textured(0.25)
    assert color_of(gltf.read(tmp_path)) == RED


def test_random_changes_of_a_rewritten_file_never_end_in_another_error(gltf, tmp_path):
    gltf.skinned({"scale": [2, 2, 2]})
    gltf.textured(0.25, extensions={"KHR_texture_transform": {"offset": [0.5, 0.0]}})
    whole = np.frombuffer(gltf.data(), np.uint8)
    draw = np.random.default_rng(7)
    for _ in range(60):
        changed = whole.copy()
        at = draw.integers(12, len(whole), 4)
        changed[at] = draw.integers(0, 256, 4)
        (tmp_path / "a.glb").write_bytes(changed.tobytes())
        with contextlib.suppress(InvalidInputError):
            read_mesh_file(tmp_path / "a.glb")


@pytest.mark.parametrize(
    "change", [{"count": 2_000_000_000}, {"byteOffset": -8}, {"byteOffset": 1 << 40}, {"bufferView": 900}]
)
def test_values_beyond_a_file_are_refused_before_they_are_rewritten(gltf, tmp_path, change):
    gltf.textured(0.25, texCoord=1)
    gltf.attribute("TEXCOORD_1", np.array([[0.75, 0.5]], "<f4"), "VEC2")
    gltf.form["accessors"][-1] |= change
    with pytest.raises(InvalidInputError, match="cannot be read"):
        gltf.read(tmp_path)


# ----------------------------------------------------------------------------------------------------------------- OBJ

TURNS = np.arange(6) * np.pi / 3
HEXAGON = "".join(f"v {0.03 * np.cos(t):.5f} {0.03 * np.sin(t):.5f} {z}\n" for z in (0, 0.1) for t in TURNS)
SIDES = "".join(f"f {k + 1}/1 {(k + 1) % 6 + 1}/1 {(k + 1) % 6 + 7}/1 {k + 7}/1\n" for k in range(6))
PRISM = f"{HEXAGON}vt 0.25 0.5\nf 6/1 5/1 4/1 3/1 2/1 1/1\nf 7/1 8/1 9/1 10/1 11/1 12/1\n{SIDES}"


def obj(folder, text, materials=None, encoding="utf-8"):
    if materials is not None:
        (folder / "m.mtl").write_bytes(materials.encode(encoding))
    (folder / "TEX.PNG").write_bytes(picture())
    (folder / "a.obj").write_bytes(text.encode(encoding))
    return read_mesh_file(folder / "a.obj")


@pytest.mark.parametrize(
    "text",
    [
        PRISM,
        PRISM.replace("f 6/1 5/1 4/1 3/1 2/1 1/1", "f -7 -8 -9 -10 -11 -12"),
        PRISM.replace("\n", "\r\n"),
        "\ufeff" + PRISM,
        "# mtllib gone.mtl\n" + PRISM,
        PRISM + "v 9 9 9\nl 1 2 13\np 13\n",
    ],
)
def test_a_prism_of_polygons_is_read_however_it_is_written(tmp_path, text):
    mesh = obj(tmp_path, text)
    vertices, faces = mesh.surface()
    assert mesh.face_count == 20
    assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(1.5 * np.sqrt(3) * 0.03**2 * 0.1, rel=1e-3)


@pytest.mark.parametrize(
    "line", ["TEX.PNG", ".\\TEX.PNG", "-s 1 1 1 -o 0 0 TEX.PNG", "-clamp on -blendu off TEX.PNG", "-imfchan r TEX.PNG"]
)
def test_options_of_a_texture_are_no_part_of_its_name(tmp_path, line):
    mesh = obj(tmp_path, f"mtllib m.mtl\nusemtl m\n{PRISM}", f"newmtl m\nmap_Kd {line}\n")
    assert color_of(mesh) == RED


def test_options_that_move_a_texture_are_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="the texture option -s 2 2 1 is not supported"):
        obj(tmp_path, f"mtllib m.mtl\nusemtl m\n{PRISM}", "newmtl m\nmap_Kd -s 2 2 1 TEX.PNG\n")


def test_a_texture_that_no_face_uses_may_be_missing(tmp_path):
    """SketchUp also writes the materials that were deleted from the object."""
    materials = "newmtl old\nKd 1 1 1\nmap_Kd gone.png\nnewmtl m\nmap_Kd TEX.PNG\nnewmtl other\n\tmap_Kd gone.png\n"
    assert color_of(obj(tmp_path, f"mtllib m.mtl\nusemtl m\n{PRISM}", materials)) == RED
    for used in ("old", "other"):
        with pytest.raises(InvalidInputError, match=r"'gone\.png', which does not exist"):
            obj(tmp_path, f"mtllib m.mtl\nusemtl {used}\n{PRISM}", materials)


def test_a_byte_order_mark_does_not_drop_the_first_material(tmp_path):
    assert color_of(obj(tmp_path, f"mtllib m.mtl\nusemtl m\n{PRISM}", "newmtl m\nKd 0 0 1\n", "utf-8-sig")) == BLUE


def test_several_files_of_materials_are_refused(tmp_path):
    """The reader of OBJ takes the first one, and the materials of the others would be gray."""
    with pytest.raises(InvalidInputError, match=r"several files \('m\.mtl', 'n\.mtl'\)"):
        obj(tmp_path, f"mtllib m.mtl\nmtllib n.mtl\nusemtl m\n{PRISM}", "newmtl m\nKd 0 0 1\n")


# ---------------------------------------------------------------------------------------------------------------- MJCF


def mjcf(folder, body, asset=""):
    BOX.export(folder / "box.stl")
    text = f'<mujoco><asset><mesh file="box.stl"/>{asset}</asset><worldbody><body>{body}</body></worldbody></mujoco>'
    (folder / "a.xml").write_text(text)
    return read_object(folder / "a.xml", FolderResolver(folder, "a.xml"))


def test_a_texture_of_a_cube_gives_its_mean_color(tmp_path):
    cube = '<texture name="t" type="cube" builtin="flat" rgb1="0 0 1" rgb2="0 0 1" width="8" height="48"/>'
    mesh = mjcf(tmp_path, '<geom type="mesh" mesh="box" material="m"/>', f'{cube}<material name="m" texture="t"/>')
    assert color_of(mesh) == BLUE


def test_an_invisible_region_without_contacts_is_no_shape(tmp_path):
    region = '<geom type="box" size=".5 .5 .5" rgba="0 0 0 0" contype="0" conaffinity="0" group="5"/>'
    assert size_of(mjcf(tmp_path, f'<geom type="mesh" mesh="box"/>{region}')) == [0.06, 0.04, 0.1]


@pytest.mark.parametrize(("stated", "mass_kg"), [("", 0.12), ('mass="0.3"', 0.42)])
def test_an_invisible_region_weighs_nothing_unless_its_mass_is_stated(tmp_path, stated, mass_kg):
    """MuJoCo gives it the density of water; RoboCasa marks the bounding box of an object in this way."""
    region = f'<geom type="box" size=".06 .06 .06" rgba="0 1 0 0" contype="0" conaffinity="0" {stated}/>'
    found = mjcf(tmp_path, f'<geom type="mesh" mesh="box" density="500"/>{region}').stated
    assert found.mass_kg == pytest.approx(mass_kg)


def test_a_body_that_weighs_only_as_a_region_keeps_this_mass(tmp_path):
    region = '<geom type="box" size=".05 .05 .05" rgba="0 1 0 0" contype="0" conaffinity="0"/>'
    found = mjcf(tmp_path, f'<freejoint/><geom type="mesh" mesh="box" mass="0"/>{region}').stated
    assert found.mass_kg == pytest.approx(1.0)
