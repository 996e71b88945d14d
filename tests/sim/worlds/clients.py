"""What the clients of the field build from an observation of LIBERO, line by line as they do.

Sources: openpi ``examples/libero/main.py`` and ``openpi_client/image_tools.py`` (Apache-2.0); Isaac-GR00T
``examples/Libero/eval/run_libero_eval.py`` and ``utils.py`` (Apache-2.0); Being-H ``BeingH/benchmark/utils/policy.py``;
starVLA ``examples/simBenchmarks/LIBERO/eval_files``; vla-evaluation-harness ``benchmarks/libero/benchmark.py``; X-VLA
``evaluation/libero/libero_client.py``.
``obs`` is what LIBERO's ``env.step`` returns, with rows from the bottom up.
"""

import math

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation


def quat2axisangle(quat):
    if quat[3] > 1.0:
        quat[3] = 1.0
    elif quat[3] < -1.0:
        quat[3] = -1.0
    den = np.sqrt(1.0 - quat[3] * quat[3])
    if math.isclose(den, 0.0):
        return np.zeros(3)
    return (quat[:3] * 2.0 * math.acos(quat[3])) / den


def resize_with_pad(image, height, width):
    image = Image.fromarray(image)
    cur_width, cur_height = image.size
    if cur_width == width and cur_height == height:
        return np.array(image)
    ratio = max(cur_width / width, cur_height / height)
    resized_height = int(cur_height / ratio)
    resized_width = int(cur_width / ratio)
    resized_image = image.resize((resized_width, resized_height), resample=Image.BILINEAR)
    zero_image = Image.new(resized_image.mode, (width, height), 0)
    pad_height = max(0, int((height - resized_height) / 2))
    pad_width = max(0, int((width - resized_width) / 2))
    zero_image.paste(resized_image, (pad_width, pad_height))
    return np.array(zero_image)


def openpi(obs, task_description):
    img = np.ascontiguousarray(obs["agentview_image"][::-1, ::-1])
    wrist_img = np.ascontiguousarray(obs["robot0_eye_in_hand_image"][::-1, ::-1])
    return {
        "observation/image": resize_with_pad(img, 224, 224),
        "observation/wrist_image": resize_with_pad(wrist_img, 224, 224),
        "observation/state": np.concatenate(
            (obs["robot0_eef_pos"], quat2axisangle(obs["robot0_eef_quat"].copy()), obs["robot0_gripper_qpos"])
        ),
        "prompt": str(task_description),
    }


def gr00t(obs, lang):
    xyz, rpy = obs["robot0_eef_pos"], quat2axisangle(obs["robot0_eef_quat"].copy())
    video = {
        "image": obs["agentview_image"][::-1, ::-1],
        "wrist_image": obs["robot0_eye_in_hand_image"][::-1, ::-1],
    }
    state = {name: np.array([value]) for name, value in zip(("x", "y", "z"), xyz, strict=True)}
    state |= {name: np.array([value]) for name, value in zip(("roll", "pitch", "yaw"), rpy, strict=True)}
    state["gripper"] = obs["robot0_gripper_qpos"]
    return {
        "video": {key: np.expand_dims(value, axis=(0, 1)) for key, value in video.items()},
        "state": {key: np.expand_dims(value, axis=(0, 1)) for key, value in state.items()},
        "language": {"annotation.human.action.task_description": [[lang]]},
    }


def being_h(obs, lang):
    state = {
        "state.eef_position": obs["robot0_eef_pos"],
        "state.eef_rotation": quat2axisangle(obs["robot0_eef_quat"].copy()),
        "state.libero_gripper_position": obs["robot0_gripper_qpos"],
    }
    video = {
        "video.top_view": obs["agentview_image"][::-1, ::-1],
        "video.wrist_view": obs["robot0_eye_in_hand_image"][::-1, ::-1],
    }
    return {
        **{key: np.expand_dims(value, axis=0) for key, value in {**video, **state}.items()},
        "language.instruction": [lang],
    }


def turned(obs):
    return obs["agentview_image"][::-1, ::-1], obs["robot0_eye_in_hand_image"][::-1, ::-1]


def starvla(obs, lang):
    images = [np.asarray(Image.fromarray(img).resize((224, 224), Image.BILINEAR)) for img in turned(obs)]
    return {"image": dict(zip(("front", "wrist"), images, strict=True)), "lang": lang}


def starvla_state(obs, lang):
    state = (obs["robot0_eef_pos"], quat2axisangle(obs["robot0_eef_quat"].copy()), obs["robot0_gripper_qpos"])
    return {**starvla(obs, lang), "state": np.concatenate(state)}


def quat_to_axisangle(quat):
    q = -quat if quat[3] < 0 else quat.copy()
    w = float(np.clip(q[3], -1.0, 1.0))
    sin_half = np.sqrt(1.0 - w * w)
    return q[:3] / sin_half * (2.0 * np.arccos(w))


def vla_eval(obs, lang):
    agentview, wrist = turned(obs)
    state = (obs["robot0_eef_pos"], quat_to_axisangle(obs["robot0_eef_quat"]), obs["robot0_gripper_qpos"])
    return {
        "images": {"agentview": agentview, "wrist": wrist},
        "task_description": lang,
        "states": np.concatenate(state),
    }


def x_vla(obs, lang):
    rotation = obs["controller_mat"].reshape(3, 3)
    proprio = np.concatenate([obs["controller_pos"], rotation[:, 0], rotation[:, 1], [0]], axis=-1)
    return {
        "domain_id": 3,
        "proprio": np.concatenate([proprio, np.zeros_like(proprio)], axis=-1),
        "language_instruction": lang,
        "image0": np.flip(np.flip(obs["agentview_image"], 0), 1),
        "image1": obs["robot0_eye_in_hand_image"],
    }


CLIENTS = {
    "openpi_libero": openpi,
    "gr00t_libero_panda": gr00t,
    "being_h_libero": being_h,
    "starvla": starvla,
    "starvla_state": starvla_state,
    "vla_eval": vla_eval,
    "x_vla": x_vla,
}


def calvin_starvla(obs, lang):
    static, gripper = (resize_with_pad(obs["rgb_obs"][name], 224, 224) for name in ("rgb_static", "rgb_gripper"))
    return {"image": {"front": static, "wrist": gripper}, "lang": lang}


def calvin_openpi(obs, lang):
    robot = obs["robot_obs"]
    return {
        "observation/image": obs["rgb_obs"]["rgb_static"],
        "observation/wrist_image": obs["rgb_obs"]["rgb_gripper"],
        "observation/state": robot[:7],
        "observation/state_ee_pos": robot[:3],
        "observation/state_ee_rot": robot[3:6],
        "observation/state_gripper": robot[6:7],
        "prompt": lang,
    }


def calvin_vla_eval(obs, lang):
    return {
        "images": {
            "rgb_static": obs["rgb_obs"]["rgb_static"],
            "rgb_gripper": resize_with_pad(obs["rgb_obs"]["rgb_gripper"], 200, 200),
        },
        "task_description": lang,
        "states": np.concatenate([obs["robot_obs"][0:7], obs["robot_obs"][14:15]]).astype(np.float32),
    }


def calvin_x_vla(obs, lang):
    robot = obs["robot_obs"]
    turned_by = Rotation.from_euler("xyz", robot[3:6]).as_matrix()[..., :, :2].reshape(6)
    proprio = np.concatenate([robot[:3], turned_by, robot[-1:] < 0.5])
    return {
        "language_instruction": lang,
        "proprio": np.concatenate([proprio, np.zeros_like(proprio)]),
        "image0": obs["rgb_obs"]["rgb_static"],
        "image1": obs["rgb_obs"]["rgb_gripper"],
        "domain_id": 2,
        "steps": 10,
    }


CALVIN_CLIENTS = {
    "starvla_calvin": calvin_starvla,
    "openpi_calvin": calvin_openpi,
    "vla_eval_calvin": calvin_vla_eval,
    "vla_eval_calvin_absolute": calvin_vla_eval,
    "x_vla_calvin": calvin_x_vla,
}
"""Sources: the same projects; RLinf ``toolkits/eval_scripts_openpi/calvin_eval.py`` for openpi."""


def differences(sent, built, at=""):
    """Yield where two requests differ: in a key, a shape, an image's byte, or a number as the float32 it is sent as."""
    if isinstance(built, dict):
        if sent.keys() != built.keys():
            yield f"{at}: {sorted(sent)} and {sorted(built)}"
            return
        for key in built:
            yield from differences(sent[key], built[key], f"{at}/{key}")
    elif isinstance(built, np.ndarray):
        expected = built if built.dtype == np.uint8 else built.astype(np.float32)
        sent = sent if sent.dtype == np.uint8 else sent.astype(np.float32)
        if sent.dtype != expected.dtype or sent.shape != expected.shape:
            yield f"{at}: {sent.dtype} {sent.shape} and {expected.dtype} {expected.shape}"
        elif sent.tobytes() != np.ascontiguousarray(expected).tobytes():
            yield f"{at}: other bytes"
    elif sent != built:
        yield f"{at}: {sent!r} and {built!r}"
