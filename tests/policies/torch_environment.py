"""An environment with PyTorch, the real LeRobot and robomimic, made once beside the project and kept in the cache.

The project itself needs neither: LeRobot pins versions of NumPy, PyAV and more that nothing else here uses, and with
everything it asks for it takes 8 GB. The code that loads a checkpoint and runs it is far smaller, so the packages below
are installed without what they drag in, 1 GB in about a minute; whatever else they import comes from the environment of
the project by a path file. The packages are the real ones and nothing in them is replaced.

``BETTER_LEROBOT_PYTHON`` names another Python that has LeRobot and the packages of this project, to be used instead.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import platformdirs

ROOT = Path(__file__).resolve().parents[2]

PACKAGES = (
    "lerobot==0.4.4",
    "torch==2.13.0",
    "torchvision==0.25.0",
    "accelerate==1.15.0",
    "cachebox==6.2.10",
    "datasets==4.8.5",
    "deepdiff==8.6.2",
    "diffusers==0.35.2",
    "dill==0.4.1",
    "draccus==0.10.0",
    "einops==0.8.2",
    "fsspec==2026.2.0",
    "httpx==0.28.1",
    "httpcore==1.0.9",
    "h11==0.16.0",
    "h5py==3.16.0",
    "anyio==4.16.0",
    "huggingface-hub==0.35.3",
    "importlib-metadata==10.2.0",
    "jsonlines==4.0.0",
    "mergedeep==1.3.4",
    "mpmath==1.3.0",
    "multiprocess==0.70.19",
    "mypy-extensions==1.2.0",
    "networkx==3.6.1",
    "num2words==0.5.14",
    "orderly-set==5.5.0",
    "pandas==3.1.1",
    "pyserial==3.5",
    "pyyaml-include==1.4.1",
    "regex==2026.11.15",
    "robomimic==0.3.0",
    "safetensors==0.8.0",
    "six==1.17.0",
    "sympy==1.14.0",
    "termcolor==3.2.0",
    "tokenizers==0.22.2",
    "toml==0.10.2",
    "transformers==4.57.3",
    "typing-inspect==0.9.0",
    "xxhash==4.1.0",
    "zipp==4.1.2",
)

# LeRobot imports torchvision, whose compiled operators on PyPI need CUDA's libraries and are missing beside a PyTorch
# for the processor alone. Its Python code then stumbles over describing one of them, which no policy here calls: the
# signature is declared, without an implementation, by a module of the environment, torchvision_for_processors, which a
# test imports before LeRobot. Where torchvision is whole, it does nothing.
DECLARE_OPERATOR = """
import torch
try:
    import torchvision
except RuntimeError as error:
    if "torchvision::nms does not exist" not in str(error):
        raise
    import sys
    for name in [n for n in sys.modules if n.partition(".")[0] == "torchvision"]:
        del sys.modules[name]
    library = torch.library.Library("torchvision", "DEF")
    library.define("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    import torchvision
"""


class NoTorchError(Exception):
    """The environment cannot be had here; the text says why."""


def torch_python() -> Path:
    """Return the Python of the environment; makes it where it is missing.

    Raises:
        NoTorchError: If its packages cannot be installed.
    """
    named = os.environ.get("BETTER_LEROBOT_PYTHON")
    if named:
        return Path(named)
    ours = sysconfig.get_paths()["purelib"]
    digest = hashlib.sha256("\n".join((*PACKAGES, ours, sys.version)).encode()).hexdigest()[:12]
    folder = platformdirs.user_cache_path("betterbench") / "tests" / f"lerobot-{digest}"
    python = folder / "bin" / "python"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder.with_suffix(".lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        if not (folder / "complete").exists():
            _make(folder, python, ours)
    return python


def _make(folder: Path, python: Path, ours: str) -> None:
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    assert spec is not None
    assert spec.loader is not None
    setup = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(setup)
    env = setup.uv_environment(os.environ)
    try:
        uv = setup.find_uv(env)
    except setup.SetupError as error:
        raise NoTorchError(str(error)) from error
    for step in (
        [uv, "venv", "--quiet", "--clear", "--python", sys.executable, folder],
        [uv, "pip", "install", "--quiet", "--no-deps", "--python", python, *PACKAGES],
    ):
        done = setup.run(step, env=env, quiet=True)
        if done.returncode != 0:
            raise NoTorchError(f"its packages cannot be installed: {' '.join(done.stdout.split())[-300:]}")
    packages = Path(
        subprocess.run(
            [python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"],
            check=True,
            capture_output=True,
            text=True,
        ).stdout.strip()
    )
    # After those of the environment itself, so that its own versions win.
    (packages / "zz_betterbench.pth").write_text(f"{ours}\n", encoding="utf-8")
    (packages / "torchvision_for_processors.py").write_text(DECLARE_OPERATOR.lstrip(), encoding="utf-8")
    (folder / "complete").touch()


def run_in_torch(
    *arguments: str, timeout_s: float = 300.0, packages: Path = ROOT / "src"
) -> subprocess.CompletedProcess[str]:
    """Run the environment's Python on this tree, without a network and with one thread.

    Args:
        arguments: What stands behind ``python``.
        timeout_s: Longest time it may take [s].
        packages: Folder of packages that come before those of the environment.

    Raises:
        NoTorchError: If there is no such environment.
    """
    env = {**os.environ, "PYTHONPATH": str(packages), "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [torch_python(), *arguments], check=False, capture_output=True, text=True, timeout=timeout_s, cwd=ROOT, env=env
    )
