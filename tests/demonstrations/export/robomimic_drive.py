"""Runs where the real robomimic is installed: reads our file with its own functions.

``robomimic_drive.py FILE EXPECTED.npz``
"""

from __future__ import annotations

import contextlib
import sys

with contextlib.suppress(ImportError):
    import torchvision_for_processors  # noqa: F401 - see torch_environment.py

import numpy as np
import robomimic
import robomimic.utils.file_utils as files
import robomimic.utils.obs_utils as observations
from robomimic.utils.dataset import SequenceDataset

LOW = ["joint_positions", "ee_position", "ee_quaternion", "gripper_width"]
IMAGES = ["front", "wrist"]


def main(path: str, expected: str) -> None:
    wanted = np.load(expected)
    observations.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": LOW, "rgb": IMAGES}})
    environment = files.get_env_metadata_from_dataset(path)
    assert environment["env_name"] == "BeTTER/MorningCoffee-v0"
    shapes = files.get_shape_metadata_from_dataset(path, all_obs_keys=[*LOW, *IMAGES])
    assert shapes["ac_dim"] == 7
    assert shapes["all_shapes"]["front"] == [3, 256, 256]
    dataset = SequenceDataset(
        hdf5_path=path,
        obs_keys=(*LOW, *IMAGES),
        dataset_keys=("actions", "rewards", "dones"),
        frame_stack=1,
        seq_length=1,
        filter_by_attribute="train",
        load_next_obs=False,
        hdf5_cache_mode=None,
    )
    assert len(dataset) == len(wanted["actions"])
    for i in range(len(dataset)):
        item = dataset[i]
        np.testing.assert_array_equal(item["actions"][0], wanted["actions"][i])
        np.testing.assert_array_equal(item["obs"]["joint_positions"][0], wanted["joint_positions"][i])
        np.testing.assert_array_equal(item["obs"]["front"][0], wanted["front"][i])
    sys.stdout.write(f"robomimic {robomimic.__version__}: {len(dataset)} frames\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
