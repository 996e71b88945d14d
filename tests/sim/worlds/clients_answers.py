"""What the clients of the field give to ``env.step`` for an answer of their server, number for number.

Sources, by function: openpi ``examples/libero/main.py``; Isaac-GR00T's LIBERO environments and OpenVLA(-OFT)
``experiments/robot/libero`` (the same two functions); Being-H ``BeingH/benchmark/libero/run_libero_eval.py``; starVLA
``examples/simBenchmarks/LIBERO/eval_files/eval_libero.py`` and ``calvin/eval_files/eval_calvin.py``;
vla-evaluation-harness ``benchmarks/libero/benchmark.py`` and ``benchmarks/calvin/benchmark.py``; X-VLA
``evaluation/libero/libero_client.py`` and ``evaluation/calvin/calvin_client.py``; RLinf
``toolkits/eval_scripts_openpi/calvin_eval.py``; VLA-Adapter ``vla-scripts/evaluate_calvin.py``.

Each function takes one row of an answer, all its keys side by side, and in CALVIN the pose that was commanded last; it
returns what is played, one flat array (in CALVIN position, rotation and gripper side by side).
"""

import numpy as np
from scipy.spatial.transform import Rotation


def unchanged(row):
    return row.copy()


def signed(row):
    """``normalize_gripper_action`` with ``binarize``, then ``invert_gripper_action``."""
    action = row.copy()
    action[-1] = 2.0 * action[-1] - 1.0
    action[-1] = np.sign(action[-1])
    action[-1] *= -1.0
    return action


def being_h(row):
    action = row.copy()
    action[-1] = -2.0 * action[-1] + 1.0
    return action


def starvla(row):
    action = row.astype(np.float32)
    action[-1] = 1.0 - 2.0 * (action[-1] > 0.5)
    return action


def vla_eval(row):
    return np.append(row[:-1], -1.0 if row[-1] < 0 else 1.0)


def x_vla(row):
    first, second = row[3:6], row[6:9]
    x = first / np.linalg.norm(first)
    y = second - np.dot(x, second) * x
    y /= np.linalg.norm(y)
    turned = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1)).as_rotvec()
    return np.concatenate([row[:3], turned, [1.0 if row[9] > 0.5 else -1.0]])


LIBERO = {
    "openpi_libero": unchanged,
    "lerobot": unchanged,
    "dexbotic": unchanged,
    "dexbotic_cogact": unchanged,
    "gr00t_libero_panda": signed,
    "openvla": signed,
    "openvla_oft": signed,
    "being_h_libero": being_h,
    "starvla": starvla,
    "starvla_state": starvla,
    "vla_eval": vla_eval,
    "vla_eval_absolute": vla_eval,
    "x_vla": x_vla,
}


def relative(row, last):
    """Relative actions go to calvin_env as they are, but for the gripper."""
    return np.append(row[:-1], 1.0 if row[-1] > 0 else -1.0)


def starvla_calvin(row, last):
    return relative(row.astype(np.float32), last)


def delta_calvin(row, last):
    pose = last + row[:6]
    pose[3:6] = (pose[3:6] + np.pi) % (2 * np.pi) - np.pi
    last[:] = pose
    return np.append(pose, 1.0 if row[6] > 0 else -1.0).astype(np.float32)


def absolute_calvin(row, last):
    angles = Rotation.from_rotvec(row[3:6].astype(np.float32)).as_euler("xyz")
    return np.concatenate([row[:3], angles, [-1.0 if row[6] > 0 else 1.0]]).astype(np.float32)


def x_vla_calvin(row, last):
    first, second = row[3:9:2], row[4:9:2]
    x = first / np.linalg.norm(first)
    y = second - np.dot(x, second) * x
    y /= np.linalg.norm(y)
    turned = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1)).as_quat()
    return np.concatenate([row[:3], turned, [1.0 if row[9] < 0.8 else -1.0]])


def being_h_calvin(row, last):
    """Being-H counts an open gripper as 1, and CALVIN opens at +1."""
    return np.append(row[:-1], 1.0 if row[-1] > 0.5 else -1.0)


def openvla_calvin(row, last):
    action = row.copy()
    sign = np.sign(2.0 * action[-1] - 1.0)
    action[-1] = -1.0 * (1.0 if sign == 0.0 else sign)
    return relative(action, last)


CALVIN = {
    "starvla_calvin": starvla_calvin,
    "openpi_calvin": relative,
    "vla_eval_calvin": delta_calvin,
    "vla_eval_calvin_absolute": absolute_calvin,
    "x_vla_calvin": x_vla_calvin,
    "gr00t_calvin": relative,
    "being_h_calvin": being_h_calvin,
    "openvla_calvin": openvla_calvin,
    "openvla_oft_calvin": openvla_calvin,
}
