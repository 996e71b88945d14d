"""Each framework's own parser takes what is written, and the values are those of the paper and the facts."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tyro
import yaml
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.export.layout import layout_of
from betterbench.demonstrations.recipes import recipe_of, setup_files, trainer_setup
from betterbench.demonstrations.recipes.trainer import SO101_COLUMNS
from betterbench.errors import BetterError, InvalidInputError, UnknownNameError
from betterbench.policies.conventions.presets import PRESETS, adapter_of
from betterbench.policies.kinds import read_address
from betterbench.tasks import get_task

sys.path.insert(0, str(Path(__file__).parent))
from upstream import OPENPI, EmbodimentTag, being_h_parser, gr00t_config, install, recorder, run_file

FRAMEWORKS = ("openpi", "gr00t", "being-h", "lerobot")
RECIPES = ("better", "libero", "calvin")


def made(framework, form="better", data=("sets/demos",), **options):
    recipe = recipe_of(form)
    setup = trainer_setup(framework, recipe, data, **options)
    return setup, setup_files(setup, recipe), {s.name: s.value for s in setup.settings}


def flags(files: dict[str, str], start: str) -> list[str]:
    """Returns the words behind the program in the command that trains."""
    (command,) = re.findall(rf"^{start}.*?(?=\n\n)", files["commands.sh"], flags=re.DOTALL | re.MULTILINE)
    words = shlex.split(command.replace("\\\n", " "))
    return words[next(i for i, word in enumerate(words) if word.endswith(".py")) + 1 :]


@pytest.mark.golden
@pytest.mark.parametrize("framework", FRAMEWORKS)
@pytest.mark.parametrize("recipe", RECIPES)
def test_golden(framework, recipe, golden):
    _, files, _ = made(framework, recipe)
    text = "".join(f"==> {name} <==\n{files[name]}\n" for name in sorted(files))
    golden(f"{framework}_{recipe}.txt", text)


@each("recipe, steps", [("better", 30_000), ("libero", 60_000), ("calvin", 50_000)])
@each("gpus", [1, 2, 4, 8])
def test_steps_and_batch_of_the_paper(recipe, steps, gpus):
    for framework in FRAMEWORKS:
        setup, _, values = made(framework, recipe, gpus=gpus)
        assert steps in (values.get(n) for n in ("num_train_steps", "--max-steps", "--max_steps", "steps"))
        decided = {s.name: s.origin for s in setup.settings}
        assert {decided.get(n) for n in ("num_train_steps", "--max-steps", "--max_steps", "steps")} == {"paper", None}
        per_step = {
            "openpi": lambda v: v["batch_size"],
            "gr00t": lambda v: v["--global-batch-size"],
            "being-h": lambda v: v["--expected_num_tokens"] // 220 * gpus,
            "lerobot": lambda v: v["batch_size"] * gpus,
        }[framework](values)
        assert per_step == 128
        assert all(s.where or s.origin == "ours" for s in setup.settings), framework


@pytest.mark.parametrize("frozen", [(), ("vision",), ("language",), ("language", "vision")])
@pytest.mark.parametrize("recipe", RECIPES)
def test_openpi_takes_the_configuration(recipe, frozen, tmp_path, monkeypatch):
    form = {"extends": recipe, "name": "mine", "frozen": {"openpi": frozen}, "proprioception": True}
    _, files, values = made("openpi", form)
    path = tmp_path / "mine_pi05.py"
    path.write_text(files["mine_pi05.py"])

    def regex(pattern):
        return lambda name: re.fullmatch(pattern, name) is not None

    install(
        monkeypatch,
        flax__nnx={
            "Nothing": lambda: lambda _: False,
            "All": lambda *f: lambda n: all(g(n) for g in f),
            "Any": lambda *f: lambda n: any(g(n) for g in f),
            "Not": lambda f: lambda n: not f(n),
        },
        openpi__shared__nnx_utils={"PathRegex": regex},
        openpi__models__pi0_config={"Pi0Config": recorder("Pi0Config")},
        openpi__training__config={n: recorder(n) for n in OPENPI if n.endswith("Config") and n != "Pi0Config"}
        | {"_CONFIGS_DICT": {}},
        openpi__training__optimizer={n: recorder(n) for n in ("CosineDecaySchedule", "AdamW")},
        openpi__training__weight_loaders={"CheckpointWeightLoader": recorder("CheckpointWeightLoader")},
    )
    found = run_file(path)
    config = found["train_config"]()
    assert config["name"] == "mine_pi05"
    assert (config["batch_size"], config["num_train_steps"]) == (128, values["num_train_steps"])
    assert config["model"] == {"pi05": True, "action_horizon": 10, "discrete_state_input": True, "class": "Pi0Config"}
    assert config["lr_schedule"]["peak_lr"] == config["lr_schedule"]["decay_lr"] == 5e-5
    assert config["data"]["base_config"]["prompt_from_task"] is True
    assert config["data"]["extra_delta_transform"] is False
    is_frozen = config["freeze_filter"]
    assert is_frozen("PaliGemma/img/head/kernel") == ("vision" in frozen)
    assert is_frozen("PaliGemma/llm/layers/attn/q_einsum/w") == ("language" in frozen)
    assert not is_frozen("PaliGemma/llm/layers/attn/q_einsum_1/w")  # the action expert
    assert not is_frozen("action_in_proj/kernel")
    # The launcher hands over to openpi's own scripts, with the configuration registered.
    script = tmp_path / "scripts/serve_policy.py"
    script.parent.mkdir()
    script.write_text("import sys, openpi.training.config as c\nprint(sorted(c._CONFIGS_DICT), sys.argv)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mine_pi05.py", "serve", "--dir", "checkpoints/1"])
    run_file(path, "__main__")
    assert sys.modules["openpi.training.config"]._CONFIGS_DICT["mine_pi05"]["name"] == "mine_pi05"
    assert sys.argv[1:] == ["policy:checkpoint", "--policy.config=mine_pi05", "--policy.dir", "checkpoints/1"]


REAL = {"act": (100_000, 8), "smolvla": (20_000, 64), "pi05": (10_000, 64)}


@pytest.mark.golden
@pytest.mark.parametrize("framework", ["openpi", "lerobot"])
def test_golden_of_the_real_arm(framework, golden):
    text = ""
    for policy in ("pi05",) if framework == "openpi" else REAL:
        _, files, _ = made(framework, "real_arm", policy=policy)
        text += "".join(f"==> {policy}: {name} <==\n{files[name]}\n" for name in sorted(files))
    golden(f"{framework}_real_arm.txt", text)


@pytest.mark.parametrize("policy", REAL)
def test_the_real_arm_has_the_papers_steps_for_pi05_and_lerobots_own_for_others(policy):
    setup, _, values = made("lerobot", "real_arm", policy=policy)
    assert (values["steps"], values["batch_size"]) == REAL[policy]
    assert values["steps"] % values["save_freq"] == 0
    decided = {s.name: s.origin for s in setup.settings}
    assert decided["steps"] == ("paper" if policy == "pi05" else "upstream")
    assert decided["batch_size"] == "upstream"
    _, _, mine = made("lerobot", {"extends": "real_arm", "steps": 5000, "batch": 16}, policy=policy)
    assert (mine["steps"], mine["batch_size"]) == (5000, 16)
    assert any("by the tablecloth" in text for text in setup.checks) == (policy == "act")
    for framework in ("lerobot", "openpi"):
        with pytest.raises(InvalidInputError, match="not a multiple of 3000"):
            made(framework, {"extends": "real_arm", "save_every": 3000}, policy=policy)


def test_the_papers_steps_are_called_the_papers_for_pi05_alone():
    setup, _, values = made("lerobot", "real_arm", policy="pi0")
    assert (values["steps"], values["batch_size"]) == (10_000, 64)
    assert {s.origin for s in setup.settings if s.name in ("steps", "batch_size")} == {"ours"}


def test_other_frameworks_have_no_recipe_for_the_real_arm():
    for framework in ("gr00t", "being-h"):
        with pytest.raises(InvalidInputError, match="Use openpi or lerobot, or choose another recipe"):
            made(framework, "real_arm")
    with pytest.raises(UnknownNameError, match="real_arm"):
        recipe_of("real_arms")


@pytest.mark.parametrize("framework", ["openpi", "lerobot"])
def test_the_paper_has_25_demonstrations_of_each_training_condition(framework):
    task = get_task("fruit_basket")
    setup, _, _ = made(framework, "real_arm", data=("sets/fruit",))
    lines = [line for _, told in setup.commands for line in told.splitlines() if line.startswith("lerobot-record")]
    assert len(lines) == len(task.training) == 4
    for number, (line, condition) in enumerate(zip(lines, task.training, strict=True)):
        words = dict(word.removeprefix("--").partition("=")[::2] for word in shlex.split(line)[1:])
        assert words["dataset.num_episodes"] == "25"
        assert words["dataset.single_task"] == condition.instruction.text
        assert ("resume" in words) == bool(number)
        assert set(yaml.safe_load(words["robot.cameras"])) == {"front", "wrist"}
        assert words["dataset.root"] == "sets/fruit"
        assert words["robot.use_degrees"] == words["teleop.use_degrees"] == "true"  # LeRobot 0.4 has another default
    assert any("100 in total" in text for text in setup.checks)


@pytest.mark.parametrize("framework", ["openpi", "lerobot"])
def test_the_commands_of_the_real_arm_are_those_of_better(framework, tmp_path, monkeypatch):
    """Each line is parsed by the command that it names; the plan is really made."""
    setup, _, _ = made(framework, "real_arm")
    monkeypatch.chdir(tmp_path)
    lines = [shlex.split(line) for line in setup.evaluation.splitlines() if not line.startswith("#")]
    assert [line[:3] for line in lines if line[1] == "real"] == [
        ["better", "real", name] for name in ("plan", "run", "judge", "report")
    ]
    plan = next(line for line in lines if line[2] == "plan")
    assert main(plan[1:]) == 0
    from betterbench.real.plan import read_plan

    found = read_plan(tmp_path / "bench")
    assert (found.rate_hz, found.unit, found.repeats, len(found.conditions)) == (20.0, "degrees", 3, 18)
    adapter = PRESETS[read_address(found.policies[0].address).options["preset"]]
    assert {rule.key[0] for rule in adapter.views} == {"observation.images.front", "observation.images.wrist"}
    evaluate = next(line for line in lines if line[1] == "eval")
    assert evaluate[evaluate.index("--action-space") + 1] == adapter.answer.space == "so101_degrees"
    assert evaluate[evaluate.index("--policy") + 1] == found.policies[0].address
    report = next(line for line in lines if line[2] == "report")
    assert report[report.index("--sim") + 1] == evaluate[evaluate.index("--out") + 1]


class Transforms:
    """openpi's transforms of actions and names, from their description."""

    class Group:
        def __init__(self, inputs=(), outputs=()):
            self.inputs, self.outputs = inputs, outputs

    @staticmethod
    def make_bool_mask(*sizes):
        return tuple(size > 0 for size in sizes for _ in range(abs(size)))

    class RepackTransform:
        def __init__(self, structure):
            self.structure = structure

        def __call__(self, data):
            return {name: data[old] for name, old in self.structure.items()}

    class DeltaActions:
        sign = -1.0

        def __init__(self, mask):
            self.mask = np.array(mask)

        def __call__(self, data):
            if "actions" in data:
                count = len(self.mask)
                data["actions"][..., :count] += self.sign * np.where(self.mask, data["state"][..., :count], 0.0)
            return data

    class AbsoluteActions(DeltaActions):
        sign = 1.0


def test_openpi_takes_the_configuration_of_the_real_arm(tmp_path, monkeypatch):
    _, files, _ = made("openpi", "real_arm")
    for name in ("real_arm_pi05.py", "better_so101.py"):
        (tmp_path / name).write_text(files[name])
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "better_so101", raising=False)
    names = ("Group", "make_bool_mask", "RepackTransform", "DeltaActions", "AbsoluteActions")
    install(
        monkeypatch,
        flax__nnx={"Nothing": lambda: lambda _: False},
        openpi__models__pi0_config={"Pi0Config": recorder("Pi0Config")},
        openpi__training__config={n: recorder(n) for n in OPENPI if n.endswith("Config") and n != "Pi0Config"}
        | {"_CONFIGS_DICT": {}, "ModelTransformFactory": dict},
        openpi__training__optimizer={n: recorder(n) for n in ("CosineDecaySchedule", "AdamW")},
        openpi__training__weight_loaders={"CheckpointWeightLoader": recorder("CheckpointWeightLoader")},
        openpi__transforms={name: getattr(Transforms, name) for name in names},
    )
    config = run_file(tmp_path / "real_arm_pi05.py")["train_config"]()
    assert (config["batch_size"], config["num_train_steps"], config["ema_decay"]) == (64, 10_000, 0.99)
    assert config["model"] == {"pi05": True, "action_horizon": 50, "discrete_state_input": True, "class": "Pi0Config"}
    data = config["data"]
    assert data["class"] == "SimpleDataConfig"
    assert data["base_config"]["action_sequence_keys"] == ["action"]
    group = data["data_transforms"](None)
    # The transforms are pickled for the worker processes of the data loader, in which this file is not __main__.
    assert {f.__module__ for f in (group.inputs[0], group.outputs[-1])} == {"better_so101"}

    draw = np.random.default_rng(0)
    state, actions = draw.normal(0.0, 40.0, 6), draw.normal(0.0, 40.0, (50, 6))
    frame = {
        "observation.images.front": draw.random((3, 480, 640), dtype=np.float32),
        "observation.images.wrist": draw.random((3, 480, 640), dtype=np.float32),
        "observation.state": state, "action": actions, "prompt": "Put the lemon into the fruit basket.",
    }  # fmt: skip
    sample = data["base_config"]["repack_transforms"].inputs[0](frame)
    for step in group.inputs:
        sample = step(sample)
    assert set(sample["image"]) == {"base_0_rgb", "left_wrist_0_rgb", "right_wrist_0_rgb"}
    for name, camera in (("base_0_rgb", "front"), ("left_wrist_0_rgb", "wrist")):
        image = np.moveaxis(frame[f"observation.images.{camera}"], 0, -1)
        assert sample["image"][name].dtype == np.uint8
        assert np.abs(sample["image"][name] / 255.0 - image).max() < 0.003
    assert [bool(v) for v in sample["image_mask"].values()] == [True, True, False]
    assert np.allclose(sample["actions"][:, :5], actions[:, :5] - state[:5], atol=1e-4)
    assert np.allclose(sample["actions"][:, 5], actions[:, 5], atol=1e-4)  # the gripper stays absolute
    assert sample["prompt"] == frame["prompt"]
    # The model's answer has 32 numbers; the robot gets six absolute ones, under the key that the preset reads.
    padded = {"state": np.pad(sample["state"], (0, 26)), "actions": np.pad(sample["actions"], ((0, 0), (0, 26)))}
    for step in group.outputs:
        padded = step(padded)
    adapter = PRESETS["lerobot_so101_degrees"]
    assert np.allclose(padded[adapter.answer.parts[0].key[0]], actions, atol=1e-4)
    # A request of better real run has its own names.
    request = {rule.key[0]: np.zeros((rule.height, rule.width, 3), np.uint8) for rule in adapter.views}
    request |= {"observation.state": state, adapter.instruction.key[0]: "Put it there."}
    asked = group.inputs[1](group.inputs[0](request))
    assert asked["prompt"] == "Put it there."
    assert asked["image"]["base_0_rgb"].shape == (256, 256, 3)


def recorded(folder, **changed):
    features = {
        name: {"dtype": "float32", "shape": [6], "names": list(SO101_COLUMNS)}
        for name in ("observation.state", "action")
    }
    for camera in ("front", "wrist"):
        features[f"observation.images.{camera}"] = {
            "dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"],
        }  # fmt: skip
    form = {"codebase_version": "v3.0", "robot_type": "so101_follower", "total_episodes": 98, "total_frames": 29_400,
            "fps": 30, "features": features, "splits": {"train": "0:98"}}  # fmt: skip
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta/info.json").write_text(json.dumps(form | changed))
    return str(folder)


def test_a_recorded_data_set_that_is_here_is_checked(tmp_path):
    place = recorded(tmp_path / "fruit")
    for framework in ("openpi", "lerobot"):
        setup, _, _ = made(framework, "real_arm", data=(place,))
        assert any("100 in total; this data set has 98." in text for text in setup.checks)
        assert any("passes over the 29,400 frames" in text for text in setup.checks)
        assert any(
            "The data are recorded at 30 Hz, but the simulated twin runs at 20 Hz" in text for text in setup.checks
        )
        assert "--rate-hz 30" in setup.evaluation
        assert not any("lerobot-record" in told for _, told in setup.commands)
    good = json.loads((tmp_path / "fruit/meta/info.json").read_text())["features"]
    for changed, says in (
        ({"codebase_version": "v2.1"}, "its format is LeRobot v2.1, expected v3.0"),
        ({"features": {k: v for k, v in good.items() if k != "action"}}, "action does not have the six positions"),
        ({"features": good | {"observation.state": {"names": ["x"] * 6}}}, "observation.state does not have the six"),
        ({"features": {k: v for k, v in good.items() if "wrist" not in k}}, "expected a camera 'wrist', found front"),
        ({"fps": 0}, "fps"),
    ):
        with pytest.raises(InvalidInputError, match=re.escape(says)):
            made("lerobot", "real_arm", data=(recorded(tmp_path / "fruit", **changed),))


def test_openpi_columns_are_those_of_its_data_config():
    layout = layout_of("openpi_libero")
    assert {*layout.all_images, *(c.name for c in layout.states), layout.action.name} == {
        *("image", "wrist_image", "state", "actions")
    }


@pytest.mark.parametrize("gpus", [1, 4])
@pytest.mark.parametrize("recipe", RECIPES)
def test_gr00t_takes_the_flags(recipe, gpus):
    _, files, values = made("gr00t", recipe, gpus=gpus)
    config = tyro.cli(gr00t_config(), args=flags(files, "python gr00t.experiment" if gpus == 1 else "torchrun"))
    frozen = recipe != "calvin"
    assert (config.tune_visual, config.tune_llm) == (not frozen, not frozen)
    assert config.tune_projector
    assert config.tune_diffusion_model
    assert config.global_batch_size == 128
    assert config.global_batch_size % config.num_gpus == 0
    assert config.state_dropout_prob == 0.0
    assert config.color_jitter_params == {"brightness": 0.3, "contrast": 0.4, "saturation": 0.5, "hue": 0.08}
    assert config.embodiment_tag.name == {"libero": "LIBERO_PANDA"}.get(recipe, "NEW_EMBODIMENT")
    # tune_llm alone leaves the top 4 layers of the language model free (facts/learning.md §3).
    assert values["config.json: tune_top_llm_layers"] == (0 if frozen else 4)
    assert config.base_model_path.endswith("-top0" if frozen else "-top4")


def test_gr00t_knows_every_number_of_the_export(tmp_path, monkeypatch):
    _, files, _ = made("gr00t", {"chunk": 12})
    registered = {}

    def modality_config(**fields):
        allowed = {"delta_indices", "modality_keys", "action_configs"}
        assert set(fields) <= allowed | {"sin_cos_embedding_keys", "mean_std_embedding_keys"}
        return fields

    install(
        monkeypatch,
        gr00t__configs__data__embodiment_configs={
            "register_modality_config": lambda config, embodiment_tag: registered.update({embodiment_tag: config})
        },
        gr00t__data__embodiment_tags={"EmbodimentTag": EmbodimentTag},
        gr00t__data__types={
            "ActionConfig": lambda **named: (named["rep"], named["type"], named["format"]),
            "ActionFormat": type("F", (), {"DEFAULT": "default"}),
            "ActionRepresentation": type("R", (), {"ABSOLUTE": "absolute"}),
            "ActionType": type("T", (), {"NON_EEF": "non_eef"}),
            "ModalityConfig": modality_config,
        },
    )
    (tmp_path / "m.py").write_text(files["better_modality.py"])
    run_file(tmp_path / "m.py")
    config = registered[EmbodimentTag.NEW_EMBODIMENT]
    layout = layout_of("gr00t_new_embodiment")
    assert config["state"]["modality_keys"] == [part.name for column in layout.states for part in column.parts]
    assert config["action"]["modality_keys"] == [part.name for part in layout.action.parts]
    assert config["action"]["delta_indices"] == list(range(12))
    assert config["action"]["action_configs"] == [("absolute", "non_eef", "default")] * 3
    assert config["video"]["modality_keys"] == ["front", "wrist"]
    assert config["language"]["modality_keys"] == [layout.adapter.instruction.key[-1]]


def test_the_copy_of_the_checkpoint_freezes_the_top_layers(tmp_path):
    _, files, _ = made("gr00t")
    source = tmp_path / "GR00T"
    (source / "experiment_cfg").mkdir(parents=True)
    (source / "config.json").write_text(json.dumps({"tune_top_llm_layers": 4, "hidden": 8}))
    (source / "model.safetensors").write_bytes(b"weights")
    (source / "experiment_cfg/metadata.json").write_text("{}")
    script = tmp_path / "prepare_checkpoint.py"
    script.write_text(files["prepare_checkpoint.py"])
    command = [sys.executable, str(script), str(source), str(tmp_path / "copy"), "0"]
    for _ in range(2):
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert "tune_top_llm_layers: 4" in said
    assert json.loads((tmp_path / "copy/config.json").read_text()) == {"tune_top_llm_layers": 0, "hidden": 8}
    assert json.loads((source / "config.json").read_text())["tune_top_llm_layers"] == 4
    assert (tmp_path / "copy/model.safetensors").read_bytes() == b"weights"
    assert (tmp_path / "copy/experiment_cfg/metadata.json").read_text() == "{}"


@each(
    "frozen, wanted",
    [
        ((), (False, False, False, False)),
        (("vision",), (False, False, True, False)),
        (("vision", "language"), (True, False, False, True)),
    ],
)
@each("recipe", RECIPES)
def test_being_h_takes_the_flags(recipe, frozen, wanted):
    _, files, _ = made("being-h", {"extends": recipe, "frozen": {"being-h": frozen}}, data=("/a/one", "/a/two"))
    given = being_h_parser().parse_args(flags(files, "torchrun"))
    assert (given.freeze_mllm, given.freeze_llm, given.freeze_vit, given.freeze_vit_mlp) == wanted
    assert given.use_flow_matching  # the default of the code is False
    assert (given.expected_num_tokens, given.max_num_tokens) == (7040, 7260)
    assert given.max_steps % given.save_steps == 0
    assert given.save_steps_start < given.max_steps
    group = f"{recipe}_posttrain"
    data = yaml.safe_load(files[f"{recipe}.yaml"])[group]
    assert data["weight"] == 1.0  # 0 if it is left out
    assert [len(data[n]) for n in ("dataset_names", "data_config_names", "embodiment_tags", "frame_step_size")] == [
        2
    ] * 4
    assert data["dataset_names"] == ["one", "two"]


def test_being_h_reads_our_columns(tmp_path, monkeypatch):
    _, files, _ = made("being-h")
    libero = type("LiberoNoNormDataConfig", (), {})
    asked = {}
    install(
        monkeypatch,
        configs__data_config={"LiberoNoNormDataConfig": libero, "DATA_CONFIG_MAP": {}},
        configs__dataset_info={"DATASET_REGISTRY": {}, "DATASET_INFO": {}, "LeRobotIterableDataset": "reader"},
        BeingH__inference__beingh_policy={"BeingHPolicy": lambda **named: asked.update(named)},
    )
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv("BEING_H_CHECKPOINT", "out/0030000")
    monkeypatch.setenv("BEING_H_PROMPT", "{x}")
    (tmp_path / "b.py").write_text(files["better_being_h.py"])
    run_file(tmp_path / "b.py")["make"]()
    made_config = sys.modules["configs.data_config"].DATA_CONFIG_MAP["better"]
    assert issubclass(made_config, libero)
    layout = layout_of("being_h_libero")
    assert {column.key[-1]: column.name for column in layout.images} == made_config.VIDEO_SOURCE_COLUMNS
    assert list(made_config.VIDEO_SOURCE_COLUMNS) == made_config.VIDEO_KEYS
    # The slices of LiberoNoNormDataConfig: state 0-3, 3-6, 6-8, action 0-3, 3-6, 6-7.
    columns = [layout.states[0], layout.action]
    slices = [[(part.key[-1], part.start, part.end) for part in column.parts] for column in columns]
    assert slices == [
        [("state.eef_position", 0, 3), ("state.eef_rotation", 3, 6), ("state.libero_gripper_position", 6, 8)],
        [("action.eef_position", 0, 3), ("action.eef_rotation", 3, 6), ("action.gripper_position", 6, 7)],
    ]
    info = sys.modules["configs.dataset_info"]
    assert info.DATASET_REGISTRY == {"better_posttrain": "reader"}
    assert info.DATASET_INFO["better_posttrain"] == {"demos": {"dataset_path": "sets/demos"}}
    assert asked["dataset_name"] == "better_posttrain"
    assert asked["data_config_name"] == "better"


@each("framework", FRAMEWORKS)
@each("recipe", ["better", "libero"])
def test_the_evaluation_names_a_preset_that_exists(framework, recipe):
    setup, _, _ = made(framework, recipe)
    for line in setup.evaluation.splitlines():
        words = shlex.split(line, comments=True)
        if words[:2] != ["better", "eval"]:
            continue
        address = read_address(words[words.index("--policy") + 1])
        if address.scheme != "lerobot":
            assert adapter_of(address).name == address.options["preset"]
        if recipe == "better" and address.scheme != "lerobot":
            assert address.options["preset"] in "".join(command for _, command in setup.commands)
    if recipe == "better":
        assert "better eval" in setup.evaluation


def exported(folder: Path, preset: str, version: str = "v2.1") -> str:
    """Writes what better export says of a data set, for the check of a recipe."""
    (folder / "meta").mkdir(parents=True)
    layout = layout_of(preset).to_json()
    sizes = {column: max(part["end"] for part in parts) for column, parts in layout["vectors"].items()}
    stats = {c: {"q01": [0.0] * n, "q99": [1.0] * (n - 1) + [0.0005]} for c, n in sizes.items()}
    source = {"layout": layout, "quality": "fast"}
    for name, form in (("betterbench", source), ("info", {"codebase_version": version, "total_frames": 48_000})):
        (folder / f"meta/{name}.json").write_text(json.dumps(form))
    (folder / "meta/stats.json").write_text(json.dumps(stats))
    return str(folder)


def test_a_data_set_that_is_here_is_checked(tmp_path):
    good = exported(tmp_path / "good", "openpi_libero")
    setup, _, _ = made("openpi", data=(good,))
    assert "80.0 passes over the 48,000 frames" in setup.checks[0]
    assert any("actions[6] is nearly constant" in text for text in setup.checks)
    assert "--quality fast" in setup.evaluation
    with pytest.raises(InvalidInputError, match=r"its layout is openpi_libero.*--preset gr00t_new_embodiment"):
        made("gr00t", data=(good,))
    new = exported(tmp_path / "new", "being_h_libero", "v3.0")
    with pytest.raises(InvalidInputError, match=r"its format is LeRobot v3.0, expected v2.1.*--to lerobot-v2.1"):
        made("being-h", data=(new,))
    (tmp_path / "good/meta/stats.json").write_text('{"state": {"q01": [0]}}')
    with pytest.raises(InvalidInputError, match="its meta files are inconsistent"):
        made("openpi", data=(good,))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InvalidInputError, match="cannot be read"):
        made("lerobot", data=(str(tmp_path / "empty"),))


@each(
    "framework, form, options, said",
    [
        ("openpi", "better", {"gpus": 3}, "a batch of 128 cannot be divided evenly among 3.*: 1, 2, 4, 8"),
        ("openpi", "better", {"gpus": 0}, "--gpus: 0 is out of range"),
        ("openpi", "better", {"data": ()}, "--data: no data set is given"),
        ("openpi", "better", {"data": ("a", "b")}, "2 data sets are given, but this trainer reads only one"),
        ("gr00t", {"proprioception": False}, {}, "GR00T cannot be trained without a state"),
        ("being-h", {"proprioception": False}, {}, "Being-H cannot be trained without a state"),
        ("being-h", {"frozen": {"being-h": ["language"]}}, {}, "freeze_llm also freezes the action expert"),
        ("being-h", "better", {"data": ("a/x", "b/x")}, "folders of the same name"),
        ("lerobot", {"frozen": {"lerobot": ["vision"]}}, {"policy": "act"}, "act has no option to freeze"),
        ("lerobot", {"steps": 30_000, "save_every": 7_000}, {}, "not a multiple of 7000"),
        ("lerobot", {"steps": 0}, {}, "steps"),
        ("lerobot", {"stepps": 1}, {}, "stepps"),
        ("lerobot", {"frozen": {"openpi": ["vision", "vision"]}}, {}, "a part is listed twice"),
        ("lerobot", {"name": "a b"}, {}, "name"),
        ("lerobot", {"chunk": 10}, {"policy": "diffusion"}, "chunk: .*10 is not a multiple of 8.*Use a multiple of 8"),
        ("openpi", "better", {"data": ("sets/my data #1",)}, "--data: 'my data #1'.*Rename the folder"),
        ("openpi", "better", {"data": ('sets/cost$5 "x" `id`',)}, "--data.*Rename the folder"),
        ("being-h", "better", {"data": ("sets/a: b",)}, "--data: 'a: b'.*Rename the folder"),
        ("openpi", "better", {"data": ("sets/..",)}, r"--data: '\.\.', the last part"),
        ("openpi", "libero", {"data": ("/",)}, "--data: '', the last part of '/'"),
    ],
)
def test_wrong_recipes_are_one_line(framework, form, options, said):
    with pytest.raises(BetterError, match=said) as caught:
        made(framework, form, **options)
    assert "\n" not in str(caught.value)


def test_names_of_data_sets_stay_text_in_being_hs_yaml():
    """Without quotes YAML would read a date."""
    setup, files, _ = made("being-h", data=("sets/2026-10-01", "sets/1e3", "sets/no"))
    (form,) = yaml.safe_load(files["better.yaml"]).values()
    assert form["dataset_names"] == ["2026-10-01", "1e3", "no"]
    assert all(repr(name) in files["better_being_h.py"] for name in form["dataset_names"])
    assert setup.settings


def test_unknown_names():
    with pytest.raises(UnknownNameError, match="better, calvin, libero"):
        recipe_of("liberro")
    with pytest.raises(UnknownNameError, match="multi_task_dit"):
        made("lerobot", policy="actt")


def test_the_verb_writes_a_folder_once(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text("extends: better\nname: mine\nsteps: 20000\nfrozen: {gr00t: []}\n")
    words = ["recipe", "gr00t", "--recipe", "mine.yaml", "--data", "sets/g", "--out", "out"]
    assert main(words) == 0
    assert main(words) == 0
    text = Path("out/README.md").read_text()
    assert "| `--max-steps` | `20000` | your recipe |" in text
    assert "| `--tune-llm` | `true` | your recipe |" in text
    assert "| `--global-batch-size` | `128` | the paper | appendix A.4 |" in text
    fields = json.loads(Path("out/fields.json").read_text())["fields"]
    assert {"name", "value", "origin", "where"} == set(fields[0])
    assert subprocess.run(["/bin/bash", "-n", "out/commands.sh"], check=False).returncode == 0
    capsys.readouterr()
    assert main([*words[:5], "other", "--out", "out"]) == 2
    assert "it contains a different" in capsys.readouterr().err.replace("\n", " ")
