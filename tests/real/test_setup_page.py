"""The page for builders has the numbers of the twin."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import real_setup_tables as tables  # noqa: E402 - of the tools, which are no package

PAGE = (ROOT / tables.PAGE).read_text(encoding="utf-8")


def test_the_tables_are_those_of_the_twin():
    """`make docs` or `python tools/real_setup_tables.py` writes them anew."""
    assert tables.filled(PAGE) == PAGE


def test_the_sheets_are_those_of_better_real_sheet():
    for name, data in tables.sheets().items():
        assert (ROOT / "docs" / name).read_bytes() == data, name
        assert f"({name})" in PAGE


def test_numbers_in_the_text_are_those_of_the_twin():
    words = " ".join(PAGE.split())
    assert f"The foot extends {tables.foot()}" in words
    from betterbench.real.sheet import camera_pose, layout
    from betterbench.sim.robots.so101 import SO101

    x, y, z = (round(1000 * v) for v in tcp_at_home())
    assert f"The tool is then {z} mm above the table, {x} mm ahead of the origin" in words
    assert y == 0
    assert f"The jaws open by {1000 * SO101.gripper_opening_m:.0f} mm" in words
    across = layout.MARKERS_MM[2][1] - layout.MARKERS_MM[6][1]
    assert f"Markers 2 and 6 are then {across:.0f} mm apart" in words
    assert f"within {100 * camera_pose.NEAR_M:.0f} cm and {camera_pose.NEAR_DEG:.0f}°" in words
    assert f"differs from the twin's by more than {camera_pose.NEAR_FOV_DEG}°" in words
    assert camera_pose.LEAST_MARKERS == 5
    assert "at least five must be visible" in words
    assert f"off by more than {100 * camera_pose.MOST_RULER:.0f} %" in words


def tcp_at_home():
    """Return the position of the tool in the arm's home posture [m]."""
    import mujoco

    from betterbench.sim.robots.so101 import SO101, build_so101

    model = build_so101(visuals=False).compile()
    data = mujoco.MjData(model)
    for name, angle in zip(SO101.arm_joints, SO101.home_joints, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    return data.site(SO101.tcp_site).xpos
