"""The asset certificate: each check passes a good asset and fails the same asset with a planted fault."""

from __future__ import annotations

import dataclasses
import importlib
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from tests.daily import others_slow

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.sim.asset_checks import AssetCertificate, certify_asset, check_names
from betterbench.sim.asset_checks.check import run_check
from betterbench.sim.asset_checks.job import certify_target, certify_targets, targets_of
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets import build
from betterbench.sim.assets.authoring.draft import Draft, block, grip, part, zone
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.authoring.turned import Turned
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.kinds import kind_of

TOOLS = Path(__file__).resolve().parents[3] / "tools"
TUB = (0.16, 0.11, 0.06)
"""Sides of the tub [m]."""


def _tool(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOOLS))
        return importlib.import_module(name)


ODD = _tool("odd_shapes")
ODD_CHECKS = {
    "half of the faces inverted": "faces_outward",
    "collision parts 2 cm aside": "collision_outside",
    "bar across the opening": "holds_ball",
    "grams as kilograms": "mass",
    "kilograms as grams": "mass",
    "inertia of a box, 100 times": "inertia",
    "negative inertia": "inertia",
    "visible spike under the base": "rest_depth",
    "wrong friction": "friction",
    "grasp wider than the gripper": "grasp_width",
}
NOT_OF_A_TUB = ("handle without collision parts", "grasp narrower than the object", "texture of another object")


@pytest.fixture(scope="module")
def planted():
    """The tool that plants faults."""
    return _tool("planted_assets")


@pytest.fixture(scope="module")
def tub():
    """An open box with walls of 6 mm, which a jaw takes at a wall."""
    x, y, z = (side / 2 for side in TUB)
    z, wall = 2 * z, 0.006
    boxes = [((-x, -y, 0), (x, y, wall))]
    for sign in (-1, 1):
        boxes.append((tuple(sorted((sign * x, sign * (x - wall)))), (-y, y), (wall, z)))
        boxes.append(((-x + wall, x - wall), tuple(sorted((sign * y, sign * (y - wall)))), (wall, z)))
    corners = [boxes[0], *(tuple(zip(*sides, strict=True)) for sides in boxes[1:])]
    parts = [part for k, (low, high) in enumerate(corners) for part in block(f"b{k}", low, high, (0.2, 0.5, 0.8))]
    draft = Draft(
        shape="box",
        description="A tub.",
        tags=("tub",),
        mass_kg=0.15,
        parts=parts,
        grasps=(grip("wall", z - 0.012, wall, x=x - wall / 2, across="x"),),
        regions=(
            zone("base", x, y),
            zone("opening", x - wall, y - wall, z),
            zone("inside", x - wall, y - wall, (z + wall) / 2, half_z=(z - wall) / 2),
        ),
        parameters={"kind": "lunchbox"},
        license="CC0-1.0",
    )
    return asset_of(draft, "tub", color="blue")


@pytest.fixture(scope="module")
def good(tub):
    """The certificate of the tub."""
    return certify_asset(tub)


def test_a_good_asset_passes_every_check_that_applies(good):
    assert good.passed, good.failed
    assert good.kind == "lunchbox"
    assert tuple(check.name for check in good.checks) == check_names()
    assert {check.name for check in good.checks if check.outcome == "not_applicable"} == {"carries_block"}
    assert all(check.sentence.endswith(".") for check in good.checks)


PLANTED = {
    "scale x10": "size",
    "scale x2.54": "size",
    "upside down": "upright",
    "on its side": "upright",
    "inverted faces": "faces_outward",
    "leaking": "holds_ball",
    "lid closed": "opening_free",
    "center of mass outside": "center_of_mass",
    "too heavy": "mass",
    "wrong grasps": "lift",
    "far parts": "connected",
    "missing texture": "textures",
    "degenerate faces": "triangles",
    "sinking": "rest_depth",
    "fat collision": "collision_outside",
    "thin collision": "collision_inside",
    "no license": "license_known",
}


@pytest.mark.parametrize(("fault", "name"), PLANTED.items())
def test_a_planted_fault_fails_its_check(planted, tub, good, fault, name):
    bad = planted.ASSET_FAULTS[fault](tub, np.random.default_rng(3))
    result = run_check(name, Subject(bad, kind_of("lunchbox")))
    assert good.check(name).outcome == "passed"
    assert result.outcome == "failed", result
    assert result.sentence.count(". ") >= 1, "a failed check says what to do"


def _closed(lid, base, *, body=0.033, height=0.11):
    """A closed jar of revolution: radii [m] of its lid and its base."""
    radii = (base, base, body, body, lid, lid, 0.0)
    heights = tuple(height * share for share in (0.0, 0.02, 0.05, 0.82, 0.83, 1.0, 1.0))
    turned = Turned((0.0, *radii), (0.0, *heights))
    parts = [part("body", turned.mesh(), (0.6, 0.3, 0.2)), *turned.filled(body)]
    draft = Draft(shape="cylinder", description="A jar.", tags=("jar",), mass_kg=0.2, parts=parts, license="CC0-1.0")
    return asset_of(draft, "jar", color="red")


@pytest.mark.parametrize(("kind", "lid"), others_slow([("jar", 0.8), ("pepper mill", 0.8), ("bottle", 0.4)], 3))
def test_a_closed_vessel_does_not_stand_on_its_lid(planted, kind, lid):
    """Seed 11 of the planted assets: a jar whose lid is a fifth narrower than its body stands firmly on it."""
    asset = _closed(lid * 0.033, 0.032)
    good, bad = (
        Subject(one, kind_of(kind))
        for one in (asset, planted.ASSET_FAULTS["upside down"](asset, np.random.default_rng(3)))
    )
    assert run_check("upright", good).outcome == "passed"
    result = run_check("upright", bad)
    assert result.outcome == "failed"
    assert "Give the axis of the file that points up with --up" in result.sentence


def test_a_jar_with_a_wide_lid_and_a_narrow_foot_stands_upright():
    assert run_check("upright", Subject(_closed(0.033, 0.028), kind_of("jar"))).outcome == "passed"
    assert run_check("upright", Subject(build("jam_jar"), kind_of("jam jar"))).outcome == "passed"


LEANS = [(0.0, "passed"), (6.0, "passed"), (14.0, "failed"), (-19.0, "failed")]


@pytest.mark.parametrize(
    ("height", "lean", "outcome"), others_slow([(h, *lean) for lean in LEANS for h in (0.05, 0.10, 0.16)], 3)
)
def test_the_axis_of_a_can_does_not_lean_even_if_it_rests_so(tub, height, lean, outcome):
    can = trimesh.creation.cylinder(0.033, height, sections=32)
    can.apply_transform(trimesh.transformations.rotation_matrix(np.radians(lean), [0.6, 0.8, 0.0]))
    vertices, faces = np.asarray(can.vertices, np.float32), np.asarray(can.faces, np.int32)
    asset = dataclasses.replace(tub, visual=(dataclasses.replace(tub.visual[0], vertices=vertices, faces=faces),))
    assert run_check("upright", Subject(asset, kind_of("can"))).outcome == outcome


@pytest.mark.parametrize("category", others_slow(["dinner_plate", "cereal_bowl", "burger"], 3))
def test_a_hollow_or_a_dome_points_up(planted, category):
    """The tags of the bowl say that it is filled, so that it need not be open at the top."""
    asset, kind = build(category), kind_of(category)
    over = planted.ASSET_FAULTS["upside down"](asset, np.random.default_rng(3))
    assert run_check("upright", Subject(asset, kind)).outcome == "passed"
    assert run_check("upright", Subject(over, kind)).outcome == "failed"


def test_a_grasp_states_its_width_and_fits_the_gripper(tub, good):
    assert good.check("grasp_width").outcome == "passed"
    assert good.check("grasp_width").measured == pytest.approx(6.0, abs=4.0)
    (grasp,) = tub.grasps
    across = dataclasses.replace(grasp, name="across", pose=grasp.pose.translated(x=-TUB[0] / 2 + 0.003), width_m=0.16)
    for wrong, said in (
        (dataclasses.replace(grasp, width_m=0.12), "120 mm, and the gripper opens 80 mm"),
        (dataclasses.replace(grasp, pose=grasp.pose.translated(z=0.1)), "there is nothing between the pads"),
        (across, "160 mm, and the gripper opens 80 mm"),
    ):
        result = run_check("grasp_width", Subject(dataclasses.replace(tub, grasps=(wrong,)), None))
        assert result.outcome == "failed"
        assert said in result.sentence
    solid = asset_of(
        Draft(
            shape="box",
            description="A block.",
            tags=("block",),
            mass_kg=0.1,
            parts=tuple(block("b", (-0.03, -0.03, 0.0), (0.03, 0.03, 0.04), (0.2, 0.5, 0.8))),
            grasps=(grip("body", 0.02, 0.02, across="x"),),
            license="CC0-1.0",
        ),
        "block",
        color="blue",
    )
    narrow = run_check("grasp_width", Subject(solid, None))
    assert narrow.outcome == "failed"
    assert "its stated width is 20 mm" in narrow.sentence
    assert run_check("grasp_width", Subject(dataclasses.replace(tub, grasps=()), None)).outcome == "not_applicable"


@pytest.mark.parametrize("fault", [name for name in ODD.ODD_ASSET_FAULTS if name not in NOT_OF_A_TUB])
def test_a_further_fault_fails_a_check(tub, fault):
    check, kind = ODD_CHECKS[fault], kind_of("lunchbox")
    bad = ODD.ODD_ASSET_FAULTS[fault](tub, np.random.default_rng(3))
    assert run_check(check, Subject(tub, kind)).outcome == "passed"
    assert run_check(check, Subject(bad, kind)).outcome == "failed"


@pytest.mark.parametrize("kind", ["lunchbox", "can"])
def test_an_object_that_leans_on_a_spike_does_not_stand(tub, kind):
    spike = np.array([[0.04, 0.03, -0.026], [0.045, 0.03, 0.003], [0.04, 0.035, 0.003], [0.036, 0.027, 0.003]])
    part = dataclasses.replace(tub.collision[0], shape="hull", vertices=spike.astype(np.float32))
    leaning = dataclasses.replace(tub, collision=(*tub.collision, part))
    result = run_check("rest_tilt", Subject(leaning, kind_of(kind)))
    assert result.outcome == "failed", result
    assert 5.0 < result.measured < 20.0
    assert result.limit == 10.0


@pytest.mark.parametrize(("slit", "outcome"), [(0.004, "passed"), (0.012, "failed")])
def test_a_few_slits_are_not_a_leak_unless_objects_fall_through(tub, slit, outcome):
    """A reduced colander keeps less than the twelve gaps that make a grid."""
    x, y, wall = TUB[0] / 2 - 0.003, TUB[1] / 2 - 0.003, 0.006
    edges = np.linspace(-x, x, 6)
    slats = [
        trimesh.creation.box(bounds=[(low + slit / 2, -y, 0.0), (high - slit / 2, y, wall)])
        for low, high in itertools.pairwise(edges)
    ]
    floor = trimesh.util.concatenate(slats)
    vertices, faces = np.asarray(floor.vertices, np.float32), np.asarray(floor.faces, np.int32)
    slatted = dataclasses.replace(tub.visual[0], vertices=vertices, faces=faces)
    subject = Subject(dataclasses.replace(tub, visual=(slatted, *tub.visual[1:])), kind_of("lunchbox"))
    assert run_check("opening_free", subject).outcome == outcome
    assert run_check("upright", subject).outcome == outcome


def test_a_handle_without_collision_parts_fails_though_it_is_a_small_part_of_the_surface(tub):
    bars = [((0.08, -0.005, z), (0.13, 0.005, z + 0.008)) for z in (0.005, 0.045)]
    bars.append(((0.122, -0.005, 0.005), (0.13, 0.005, 0.053)))
    shown, touched = zip(*(block(f"h{k}", *bar, (0.2, 0.5, 0.8)) for k, bar in enumerate(bars)), strict=True)
    whole = dataclasses.replace(tub, visual=(*tub.visual, *shown), collision=(*tub.collision, *touched))
    bare = dataclasses.replace(whole, collision=tub.collision)
    assert run_check("collision_inside", Subject(bare, None)).outcome == "passed"
    assert run_check("collision_complete", Subject(whole, None)).measured == 0.0
    result = run_check("collision_complete", Subject(bare, None))
    assert result.outcome == "failed"
    assert result.limit < result.measured < 0.05
    assert "farther than 8.8 mm from the collision parts" in result.sentence


def test_a_lid_also_keeps_the_ball_out(planted, tub):
    lid = planted.ASSET_FAULTS["lid closed"](tub, np.random.default_rng(3))
    assert run_check("holds_ball", Subject(lid, None)).outcome == "failed"


def test_an_invisible_spike_below_the_base_fails_even_if_the_asset_lies_still(tub):
    spike = np.array(
        [[0.05, 0.03, -0.006], [0.054, 0.03, 0.004], [0.046, 0.03, 0.004], [0.05, 0.034, 0.004]], np.float32
    )
    part = dataclasses.replace(tub.collision[0], shape="hull", vertices=spike, position=(0.0, 0.0, 0.0))
    result = run_check("rest_depth", Subject(dataclasses.replace(tub, collision=(*tub.collision, part)), None))
    assert result.outcome == "failed"
    assert "reach 6 mm below its visible surface" in result.sentence


@pytest.mark.parametrize("seed", range(3))
def test_an_asset_with_a_rocking_base_or_an_inertia_of_no_body_fails(planted, tub, seed):
    subject = Subject(planted.ASSET_FAULTS["jittering"](tub, np.random.default_rng(seed)), None)
    names = ("inertia", "rest_tilt", "rest_drift", "rest_jitter", "rest_depth", "collision_outside")
    assert any(run_check(name, subject).outcome == "failed" for name in names)


def test_a_support_carries_a_block_only_if_its_top_is_where_it_says():
    asset = build("block")
    assert run_check("carries_block", Subject(asset, None)).outcome == "passed"
    top = asset.region("top")
    raised = dataclasses.replace(top, position=(0.03, 0.0, top.position[2]))
    beside = dataclasses.replace(asset, regions=(raised,))
    assert run_check("carries_block", Subject(beside, None)).outcome == "failed"


def test_an_object_that_its_kind_says_can_be_lifted_has_to_have_a_grasp():
    fork = build("fork")
    kind = kind_of("fork")
    assert run_check("lift", Subject(fork, kind)).outcome == "passed"
    without = dataclasses.replace(fork, grasps=())
    assert run_check("lift", Subject(without, kind)).outcome == "failed"
    assert run_check("lift", Subject(without, None)).outcome == "not_applicable"


def test_an_asset_that_cannot_be_measured_fails_instead_of_raising(tub):
    part = tub.visual[0]
    vertices = part.vertices.copy()
    vertices[0] = np.nan
    broken = dataclasses.replace(tub, visual=(dataclasses.replace(part, vertices=vertices), *tub.visual[1:]))
    certificate = certify_asset(broken)
    assert not certificate.passed
    assert certificate.check("triangles").outcome == "failed"


def test_a_certificate_has_a_json_form_and_comes_back(good):
    form = json.loads(json.dumps(good.to_json()))
    assert form["passed"] is True
    assert AssetCertificate.from_json(form) == good
    with pytest.raises(InvalidInputError, match="version 99"):
        AssetCertificate.from_json({**form, "version": 99})
    with pytest.raises(InvalidInputError, match="is not an asset certificate"):
        AssetCertificate.from_json({"asset": "mug"})


def test_names_files_and_folders_are_told_apart(tmp_path):
    trimesh.creation.box((0.05, 0.05, 0.05)).export(tmp_path / "block.stl")
    (tmp_path / "notes.txt").write_text("no mesh")
    wishes = Wishes(license="CC0-1.0")
    folder, name, look = targets_of([str(tmp_path), "mug", "mug-red#3"], wishes)
    assert (folder.file, folder.name) == (tmp_path / "block.stl", "block.stl")
    assert (name.name, name.file, name.color) == ("mug", None, None)
    assert (look.name, look.color, look.look) == ("mug", "red", 3)
    with pytest.raises(InvalidInputError, match="no asset is given"):
        targets_of([], wishes)
    with pytest.raises(InvalidInputError, match="Check the assets one by one"):
        targets_of(["mug", "can"], Wishes(size_m=0.1))
    with pytest.raises(UnknownNameError, match="mug"):
        certify_target(targets_of(["mugg"], wishes)[0])


def test_certificates_are_kept_and_only_the_missing_ones_are_made(tmp_path, monkeypatch):
    asked = []

    def certify(target):
        asked.append(target.name)
        return AssetCertificate(target.name, "", None, "", "CC0-1.0", ())

    monkeypatch.setattr("betterbench.sim.asset_checks.job.certify_target", certify)
    first = certify_targets(targets_of(["mug"], Wishes()), tmp_path)
    both = certify_targets(targets_of(["mug", "can"], Wishes()), tmp_path)
    assert asked == ["mug", "can"]
    assert [one.asset for one in both] == ["mug", "can"]
    assert both[0] == first[0]


@pytest.mark.usefixtures("imports_here")
def test_the_command_prints_what_failed_and_exits_with_one(good, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with monkeypatch.context() as patch:  # the certificate of the tub is already made
        patch.setattr("betterbench.sim.asset_checks.job.certify_target", lambda _: good)
        assert main(["assets", "check", "block", "--json"]) == 0
    (form,) = json.loads(capsys.readouterr().out)
    assert (form["passed"], form["kind"]) == (True, "lunchbox")
    with pytest.raises(SystemExit) as ended:
        main(["assets", "check", "block", "--kind", "mug"])
    assert ended.value.code == 1
    assert "A mug should be open at the top" in " ".join(capsys.readouterr().out.split())
    path = tmp_path / "broken.glb"
    path.write_bytes(b"nothing")
    with pytest.raises(SystemExit):
        main(["assets", "check", str(path)])
    assert "not imported: broken.glb" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_planted_bad_assets_are_found_and_good_ones_are_kept(planted, meshes_if_here, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))  # for the worker processes
    out = tmp_path / "planted"
    results = planted.measure(planted.make_plan(0, out, meshes_if_here, each=3), out, workers=2)
    rates = planted.print_table(results)
    assert sum(result.fault is not None for result in results) >= 60
    assert rates["false_accepts"] <= 0.01
    assert rates["good_kept"] >= 0.95
    assert rates["still"] >= 0.99


@pytest.mark.slow
def test_real_meshes_pass_without_a_person(meshes, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))  # for the worker processes
    tool = _tool("real_meshes")
    rates = tool.print_summary(tool.measure(tool.named_files(meshes), tmp_path, workers=2))
    assert rates["imported"] == 1.0
    assert rates["passed"] >= 0.90
    assert rates["still"] >= 0.99
    assert rates["median_s"] <= 8.0
