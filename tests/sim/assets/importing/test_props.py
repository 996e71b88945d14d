"""Props in URDF and MJCF files: what is read of them, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.importing.importer import Wishes, import_mesh
from betterbench.sim.assets.importing.mesh_file import FolderResolver
from betterbench.sim.assets.importing.object_file import read_object
from betterbench.sim.assets.importing.physics import stated_body
from betterbench.sim.assets.importing.upright import place


def read(path, **options):
    return read_object(path, FolderResolver(path.parent, path.name), **options)


def write(path, text):
    path.write_text(text)
    return path


def size_of(mesh):
    return np.ptp(mesh.bounds(), axis=0)


@pytest.fixture
def folder(tmp_path):
    trimesh.creation.box((0.06, 0.04, 0.1)).export(tmp_path / "box.obj")
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.06, 0.04, 0.1)).export(tmp_path / "meshes" / "part.stl")
    return tmp_path


def urdf(body, name="toy"):
    return f'<?xml version="1.0"?><robot name="{name}">{body}</robot>'


LINK = '<link name="{0}"><visual>{1}<geometry>{2}</geometry></visual></link>'
BOX = '<box size="0.06 0.04 0.1"/>'
FIXED = '<joint name="{0}" type="{1}"><parent link="a"/><child link="b"/><origin xyz="0 0 0.1" rpy="{2}"/></joint>'


# --------------------------------------------------------------------------------------------------------------- URDF


def test_links_joined_by_fixed_joints_are_one_body(folder):
    quarter = f"0 0 {np.pi / 2}"
    text = urdf(LINK.format("a", "", BOX) + LINK.format("b", "", BOX) + FIXED.format("j", "fixed", quarter))
    mesh = read(write(folder / "toy.urdf", text))
    assert (mesh.up, mesh.unit_m) == ("z", 1.0)
    assert np.allclose(size_of(mesh), (0.06, 0.06, 0.2))
    assert np.allclose(mesh.parts[1].vertices.mean(axis=0), (0, 0, 0.1), atol=1e-9)


@pytest.mark.parametrize(
    ("rpy", "expected"),
    [
        ("1.5707963267948966 0 0", (0, 0, 1)),  # roll brings y to z
        ("0 0 1.5707963267948966", (-1, 0, 0)),  # yaw brings y to -x
        ("1.5707963267948966 0 1.5707963267948966", (0, 0, 1)),  # roll first, about the fixed axes
    ],
)
def test_roll_pitch_and_yaw_turn_about_the_fixed_axes(folder, rpy, expected):
    small = '<sphere radius="0.01"/>'
    shape = LINK.format("a", "", BOX) + LINK.format("b", '<origin xyz="0 1 0"/>', small)
    joint = FIXED.format("j", "fixed", rpy)
    mesh = read(write(folder / "toy.urdf", urdf(shape + joint)))
    assert np.allclose(mesh.parts[1].vertices.mean(axis=0) - (0, 0, 0.1), expected, atol=1e-6)


@pytest.mark.parametrize("name", ["meshes/part.stl", "package://meshes/part.stl", "package://toy/meshes/part.stl"])
def test_meshes_are_found_in_the_folder_and_scaled(folder, name):
    shape = f'<mesh filename="{name}" scale="0.5 1 1"/>'
    mesh = read(write(folder / "toy.urdf", urdf(LINK.format("a", "", shape))))
    assert np.allclose(size_of(mesh), (0.03, 0.04, 0.1), atol=1e-6)


def test_a_mirrored_mesh_keeps_its_outside_out(folder):
    shape = '<mesh filename="box.obj" scale="-1 1 1"/>'
    (part,) = read(write(folder / "toy.urdf", urdf(LINK.format("a", "", shape)))).parts
    assert trimesh.Trimesh(part.vertices, part.faces).volume == pytest.approx(0.06 * 0.04 * 0.1)


def test_colors_are_those_of_materials_by_name(folder):
    head = '<material name="red"><color rgba="0.8 0.1 0 1"/></material>'
    visual = f'<visual><geometry>{BOX}</geometry><material name="red"/></visual>'
    (part,) = read(write(folder / "toy.urdf", urdf(f'{head}<link name="a">{visual}</link>'))).parts
    assert part.rgba == (0.8, 0.1, 0.0, 1.0)


def test_mass_of_several_links_is_that_of_the_whole(folder):
    inertial = (
        '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="2e-4" izz="3e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    link = '<link name="{0}">' + inertial + f"<visual><geometry>{BOX}</geometry></visual></link>"
    quarter = f"0 0 {np.pi / 2}"
    text = urdf(link.format("a") + link.format("b") + FIXED.format("j", "fixed", quarter))
    stated = read(write(folder / "toy.urdf", text)).stated
    assert stated.mass_kg == pytest.approx(0.2)
    assert np.allclose(stated.center, (0, 0, 0.05))
    # Each is 5 cm from the middle; the second is turned by a quarter, so x and y are exchanged.
    shift = 0.1 * 0.05**2
    assert np.allclose(np.diag(stated.inertia), (3e-4 + 2 * shift, 3e-4 + 2 * shift, 6e-4))


def test_a_joint_that_moves_is_named_unless_it_is_frozen(folder):
    text = urdf(LINK.format("a", "", BOX) + LINK.format("b", "", BOX) + FIXED.format("lid hinge", "revolute", "0 0 0"))
    path = write(folder / "toy.urdf", text)
    with pytest.raises(InvalidInputError, match=r"joint 'lid hinge' \(revolute\) is movable.*--freeze"):
        read(path)
    mesh = read(path, freeze=True)
    assert mesh.stated.notes == ("joint 'lid hinge' is fixed at 0",)
    assert np.allclose(size_of(mesh), (0.06, 0.04, 0.2))


ONE = LINK.format("a", "", BOX)
RING = FIXED.format("j", "fixed", "0 0 0") + FIXED.format("k", "fixed", "0 0 0").replace('"a"', '"x"').replace(
    '"b"', '"a"'
).replace('"x"', '"b"')


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("", "has no link"),
        ('<link name="a"/>', "none of its links has a shape"),
        ("<link><visual/></link>", "a link has no name"),
        (LINK.format("a", "", "<blob/>"), "geometry type 'blob' is not supported"),
        (LINK.format("a", "", '<box size="0.1 0.1"/>'), "box size is '0.1 0.1', expected 3 finite numbers"),
        (LINK.format("a", "", '<box size="0.1 nan 0.1"/>'), "expected 3 finite numbers"),
        (LINK.format("a", "", '<sphere radius="-1"/>'), "radius is -1"),
        (LINK.format("a", '<origin xyz="nan 0 0"/>', BOX), "origin xyz is 'nan 0 0', expected 3 finite numbers"),
        (LINK.format("a", '<origin xyz="0 0 1e300"/>', BOX), "expected numbers of at most 1000"),
        (LINK.format("a", "", '<mesh filename="box.obj" scale="0 1 1"/>'), "factor of 0"),
        (LINK.format("a", "", '<mesh filename="gone.obj"/>'), "'gone.obj', which does not exist"),
        (LINK.format("a", "", '<mesh filename="model.dae"/>'), "does not exist"),
        (ONE + LINK.format("b", "", BOX), "'a' and 'b' are not connected by a joint"),
        (ONE + LINK.format("b", "", BOX) + RING, "closed loop|two parents"),
        (ONE + FIXED.format("j", "fixed", "0 0 0"), "the child of its joint 'j' is 'b', which is not a link"),
        (ONE + LINK.format("b", "", BOX) + FIXED.format("j", "screw", "0 0 0"), "has the type 'screw'"),
        ('<xacro:macro name="m"/>' + ONE, "not XML|macro"),
        (LINK.format("a", "", BOX * 3), "does not have exactly one geometry"),
        ("".join(f'<link name="l{k}"/>' for k in range(300)), "300 links"),
    ],
)
def test_a_urdf_file_that_cannot_be_used_is_one_clear_line(folder, body, text):
    path = write(folder / "toy.urdf", urdf(body))
    with pytest.raises(InvalidInputError, match=text) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert "toy.urdf" in str(caught.value)


# --------------------------------------------------------------------------------------------------------------- MJCF


def mjcf(bodies, asset="", head=""):
    return f'<mujoco model="toy">{head}<asset>{asset}</asset><worldbody>{bodies}</worldbody></mujoco>'


MESH = '<mesh name="m" file="{0}"/>'
BODY = '<body name="toy" pos="0 0 1">{0}<geom type="mesh" mesh="m"/></body>'


def test_bodies_are_where_mujoco_puts_them(folder):
    text = mjcf(
        '<geom type="plane" size="1 1 .1"/><body name="toy" pos="0 0 1" euler="0 0 90"><freejoint/>'
        '<geom type="mesh" mesh="part" pos="0 0 0.2" rgba="0 0 1 1"/></body>',
        '<mesh file="part.stl" scale="1 2 1"/>',
        '<compiler meshdir="meshes" angle="degree"/>',
    )
    mesh = read(write(folder / "toy.xml", text))
    (part,) = mesh.parts
    assert np.allclose(size_of(mesh), (0.08, 0.06, 0.1), atol=1e-6)
    assert np.allclose(part.vertices.mean(axis=0), (0, 0, 1.2), atol=1e-6)
    assert part.rgba == (0.0, 0.0, 1.0, 1.0)
    assert mesh.stated.mass_kg is None  # 1,000 kg/m^3 is MuJoCo's, not the file's


def test_what_touches_nothing_is_what_is_seen(folder):
    text = mjcf(
        '<body><geom type="mesh" mesh="m" contype="0" conaffinity="0" group="2" mass="0"/>'
        '<geom type="box" size="0.03 0.02 0.05" group="3" mass="0.2"/></body>',
        MESH.format("box.obj"),
    )
    mesh = read(write(folder / "toy.xml", text))
    assert len(mesh.parts) == len(mesh.stated.hulls) == 1
    assert mesh.stated.mass_kg == pytest.approx(0.2)
    moments = np.linalg.eigvalsh(mesh.stated.inertia)
    assert np.allclose(sorted(moments), sorted(0.2 / 12 * np.array([0.0116, 0.0136, 0.0052])))


def test_a_texture_is_the_right_way_up(folder):
    """The same textured square as OBJ file and as MJCF file has the same colors at the same places."""
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:4] = (255, 0, 0)  # red above, blue below
    pixels[4:] = (0, 0, 255)
    Image.fromarray(pixels).save(folder / "skin.png")
    corners = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.01, 0.1), (0, 0.01, 0.1), (0.05, 0.05, 0.05)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "vt 0.5 0.5"]
    lines += ["f 1/1 2/2 3/3", "f 1/1 3/3 4/4", "f 2/2 1/1 5/5", "f 3/3 2/2 5/5", "f 4/4 3/3 5/5", "f 1/1 4/4 5/5"]
    (folder / "skin.mtl").write_text("newmtl s\nKd 1 1 1\nmap_Kd skin.png\n")
    (folder / "skin.obj").write_text("\n".join(["mtllib skin.mtl", "usemtl s", *lines]))
    asset = MESH.format("skin.obj") + '<texture name="t" type="2d" file="skin.png"/><material name="s" texture="t"/>'
    text = mjcf('<body><geom type="mesh" mesh="m" material="s"/></body>', asset)
    for mesh in (read(folder / "skin.obj"), read(write(folder / "toy.xml", text))):
        (part,) = mesh.parts
        middle = np.full((len(part.faces), 3), 1 / 3)
        colors = part.colors_at(np.arange(len(part.faces)), middle)
        heights = part.vertices[part.faces].mean(axis=1)[:, 2]
        red = colors[:, 0] > colors[:, 2]
        off_middle = np.abs(heights - 0.05) > 0.01
        assert (red == (heights > 0.05))[off_middle].all()
        assert off_middle.sum() >= 2


def test_a_joint_that_moves_is_named_in_mjcf_too(folder):
    text = mjcf(BODY.format('<joint name="drawer" type="slide" range="0 1"/>'), MESH.format("box.obj"))
    path = write(folder / "toy.xml", text)
    with pytest.raises(InvalidInputError, match=r"joint 'drawer' is movable.*--freeze"):
        read(path)
    assert read(path, freeze=True).stated.notes == ("joint 'drawer' is fixed at its reference",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (mjcf(""), "none of its bodies has a shape"),
        (mjcf('<body><geom type="blob"/></body>'), "MuJoCo rejects it"),
        (mjcf('<body pos="nan 0 0"><geom size="0.1"/></body>'), "MuJoCo rejects it|not finite"),
        (
            mjcf('<body><freejoint/><geom size=".1"/></body><body><freejoint/><geom size=".1"/></body>'),
            "are separate objects",
        ),
        (mjcf('<replicate count="9999999"><body><geom size="0.1"/></body></replicate>'), "element replicate"),
        (mjcf('<body><composite type="cable" count="9999999 1 1"/></body>'), "element composite"),
        (mjcf("", '<hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/>'), "element hfield"),
        (mjcf("", '<model file="other.xml"/>'), "element model"),
        (mjcf(BODY.format(""), MESH.format("gone.obj")), "'gone.obj', which does not exist"),
        (mjcf("".join('<body><geom size="0.1"/></body>' for _ in range(300))), "300 bodies"),
        ("<html/>", "first element is 'html'"),
        ("<mujoco><worldbody><body>", "not XML"),
    ],
)
def test_an_mjcf_file_that_cannot_be_used_is_one_clear_line(folder, text, said):
    path = write(folder / "toy.xml", text)
    with pytest.raises(InvalidInputError, match=said) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert "toy.xml" in str(caught.value)


# -------------------------------------------------------------------------------------------------------- as an asset


def hulls_of(found):
    return [part for part in found.draft.parts if isinstance(part, CollisionPart)]


def test_physics_that_fits_is_kept(folder):
    inertia = 0.3 / 12 * np.array([0.0116, 0.0136, 0.0052])
    inertial = (
        '<inertial><origin xyz="0 0 0.01"/><mass value="0.3"/>'
        f'<inertia ixx="{inertia[0]}" iyy="{inertia[1]}" izz="{inertia[2]}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    shape = '<geometry><mesh filename="box.obj"/></geometry>'
    two = "".join(
        f'<collision><origin xyz="0 0 {z}"/><geometry><box size="0.06 0.04 0.05"/></geometry></collision>'
        for z in (-0.025, 0.025)
    )
    text = urdf(f'<link name="a">{inertial}<visual>{shape}</visual>{two}</link>')
    found = import_mesh(write(folder / "block.urdf", text), Wishes())
    assert found.kind.name == "block"
    assert found.draft.body.mass_kg == 0.3
    assert found.draft.body.center_of_mass == pytest.approx((0, 0, 0.06), abs=1e-6)
    assert found.draft.body.inertia[:3] == pytest.approx(inertia, rel=1e-4)
    assert len(hulls_of(found)) == 2
    assert "2 collision shapes of the file" in found.notes
    # Half as large: the mass stays as it is stated, and the inertia is that of the smaller body.
    half = import_mesh(folder / "block.urdf", Wishes(size_m=0.05))
    assert half.draft.body.mass_kg == 0.3
    assert half.draft.body.inertia[:3] == pytest.approx(inertia / 4, rel=1e-4)
    assert half.draft.body.center_of_mass == pytest.approx((0, 0, 0.03), abs=1e-6)


def test_physics_that_does_not_fit_is_replaced_and_told(folder):
    inertial = (
        '<inertial><origin xyz="0 0 5"/><mass value="0.3"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    collision = '<collision><geometry><box size="0.1 0.08 0.14"/></geometry></collision>'
    visual = '<visual><geometry><mesh filename="box.obj"/></geometry></visual>'
    text = urdf(f'<link name="a">{inertial}{visual}{collision}</link>')
    found = import_mesh(write(folder / "block.urdf", text), Wishes())
    assert any("center of mass is outside" in note for note in found.notes)
    assert any("off the surface: new shapes were made" in note for note in found.notes)
    assert found.draft.body.center_of_mass == pytest.approx((0, 0, 0.05), abs=0.002)
    assert found.draft.body.inertia[0] == pytest.approx(0.3 / 12 * 0.0116, rel=0.1)
    (hull,) = hulls_of(found)
    assert np.ptp(hull.vertices, axis=0) == pytest.approx((0.06, 0.04, 0.1), abs=0.002)


def test_an_object_that_would_tip_over_gets_the_center_of_its_solid(folder):
    """A table with a foot of 2 cm: a center of mass 2 cm beside the middle is inside its box, but not over the foot."""
    top, foot = trimesh.creation.box((0.06, 0.06, 0.02)), trimesh.creation.box((0.02, 0.02, 0.06))
    top.apply_translation((0, 0, 0.04))
    trimesh.util.concatenate([top, foot]).export(folder / "table.obj")
    visual = '<visual><geometry><mesh filename="table.obj"/></geometry></visual>'
    inertia = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
    for x, kept in ((0.005, True), (0.02, False)):
        inertial = f'<inertial><origin xyz="{x} 0 0.03"/><mass value="0.3"/>{inertia}</inertial>'
        path = write(folder / "block.urdf", urdf(f'<link name="a">{inertial}{visual}</link>'))
        body, notes = stated_body(place(read(path), None, "block.urdf", up="z", size_m=0.08), None)
        assert any("it would tip over" in note for note in notes) is not kept
        assert body.center[0] == pytest.approx(x if kept else 0.0, abs=1e-3)


def test_collision_shapes_that_fill_a_hollow_are_made_anew(folder):
    r, h, w = 0.04, 0.09, 0.004
    cup = trimesh.creation.revolve([(0, 0), (r, 0), (r, h), (r - w, h), (r - w, w), (0, w)], sections=12)
    cup.export(folder / "cup.stl")
    mesh = '<geom type="mesh" mesh="m" {}/>'
    seen, touched = mesh.format('contype="0" conaffinity="0"'), mesh.format('group="3"')
    text = mjcf(f"<body>{seen}{touched}</body>", MESH.format("cup.stl"))
    found = import_mesh(write(folder / "mug.xml", text), Wishes())
    assert len(hulls_of(found)) > 8
    assert any("new shapes were made" in note for note in found.notes)
