"""Run by an interpreter with the real LeRobot: makes a tiny ACT checkpoint that never moves, and evaluates it.

- ``python lerobot_drive.py command FOLDER``: by the main function of ``lerobot-eval``, on one condition.
- ``python lerobot_drive.py installed FOLDER``: on two conditions, where LeRobot itself has to find our package.
- ``python lerobot_drive.py hub FOLDER``: two conditions, from the hub package, in processes of their own. These import
  this file again, so that everything heavy is imported where it is used.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path


def make_checkpoint(folder: Path) -> None:
    """Write a policy with random weights that looks at the front camera and the state, and hardly scales its output."""
    import torch
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    torch.manual_seed(0)
    config = ACTConfig(
        input_features={
            "observation.state": PolicyFeature(type=FeatureType.STATE, shape=(8,)),
            "observation.images.front": PolicyFeature(type=FeatureType.VISUAL, shape=(3, 256, 256)),
        },
        output_features={"action": PolicyFeature(type=FeatureType.ACTION, shape=(7,))},
        chunk_size=50,
        n_action_steps=50,
        dim_model=16,
        n_heads=2,
        dim_feedforward=16,
        n_encoder_layers=1,
        n_decoder_layers=1,
        n_vae_encoder_layers=1,
        latent_dim=4,
        pretrained_backbone_weights=None,
        device="cpu",
        push_to_hub=False,
    )
    ACTPolicy(config).save_pretrained(folder)
    stats = {
        "observation.state": {"mean": torch.zeros(8), "std": torch.ones(8)},
        "observation.images.front": {"mean": torch.zeros(3, 1, 1), "std": torch.ones(3, 1, 1)},
        "action": {"mean": torch.tensor([0.0] * 6 + [-1.0]), "std": torch.full((7,), 1e-6)},
    }
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)


def command(folder: Path) -> None:
    """Evaluate as the command does, and name the package that makes our environments known."""
    evaluate(folder, "--env.discover_packages_path=betterbench.episodes.envhub", "--env.task=morning_coffee/T1")


def installed(folder: Path) -> None:
    """Evaluate as the command does, and name no package."""
    evaluate(folder, "--env.task=morning_coffee/T1,morning_coffee/train1")


def evaluate(folder: Path, *words: str) -> None:
    """Call the main function of the command with these arguments and the common ones."""
    from lerobot.scripts import lerobot_eval

    sys.argv = [
        "lerobot-eval",
        f"--policy.path={folder / 'checkpoint'}",
        "--policy.device=cpu",
        "--env.type=betterbench",
        *words,
        "--env.quality=fast",
        "--eval.n_episodes=1",
        "--eval.batch_size=1",
        "--seed=3",
        f"--output_dir={folder / 'out'}",
    ]
    lerobot_eval.main()


def hub(folder: Path) -> None:
    """Make the environments as LeRobot makes those of a hub package, and evaluate them as the command does."""
    import torch
    from lerobot.envs.utils import _call_make_env, _import_hub_module, _normalize_hub_result, close_envs
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors
    from lerobot.processor.pipeline import PolicyProcessorPipeline
    from lerobot.scripts import lerobot_eval

    from betterbench.episodes import envhub
    from betterbench.episodes.envhub.config import BetterbenchEnv

    cfg = BetterbenchEnv(task="morning_coffee/T1,morning_coffee/train1", quality="fast")
    module = _import_hub_module(str(Path(envhub.__path__[0]) / "env.py"), "you/better")
    envs = _normalize_hub_result(_call_make_env(module, n_envs=1, use_async_envs=True, cfg=cfg))
    policy = ACTPolicy.from_pretrained(folder / "checkpoint")
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(folder / "checkpoint"))
    nothing = PolicyProcessorPipeline(steps=[])
    with torch.no_grad():
        info = lerobot_eval.eval_policy_all(envs, policy, nothing, nothing, before, after, 1, start_seed=0)
    close_envs(envs)
    (folder / "hub.json").write_text(json.dumps(info))


if __name__ == "__main__":
    with contextlib.suppress(ModuleNotFoundError):
        import torchvision_for_processors  # noqa: F401 - only where torchvision's operators are missing
    place = Path(sys.argv[2])
    make_checkpoint(place / "checkpoint")
    {"command": command, "installed": installed, "hub": hub}[sys.argv[1]](place)
