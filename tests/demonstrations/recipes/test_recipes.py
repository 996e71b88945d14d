"""Each framework's own parser takes what is written, and the values are those of the paper and the facts."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import tyro
import yaml

from betterbench.cli.main import main
from betterbench.demonstrations.export.layout import layout_of
from betterbench.demonstrations.recipes import recipe_of, setup_files, trainer_setup
from betterbench.errors import BetterError, InvalidInputError, UnknownNameError
from betterbench.policies.conventions.presets import adapter_of
from betterbench.policies.kinds import read_address

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


@pytest.mark.parametrize(("recipe", "steps"), [("better", 30_000), ("libero", 60_000), ("calvin", 50_000)])
@pytest.mark.parametrize("gpus", [1, 2, 4, 8])
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


@pytest.mark.parametrize(
    ("frozen", "wanted"),
    [
        ((), (False, False, False, False)),
        (("vision",), (False, False, True, False)),
        (("vision", "language"), (True, False, False, True)),
    ],
)
@pytest.mark.parametrize("recipe", RECIPES)
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


@pytest.mark.parametrize("framework", FRAMEWORKS)
@pytest.mark.parametrize("recipe", ["better", "libero"])
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
    with pytest.raises(InvalidInputError, match=r"it is LeRobot v3.0, not v2.1.*--to lerobot-v2.1"):
        made("being-h", data=(new,))
    (tmp_path / "good/meta/stats.json").write_text('{"state": {"q01": [0]}}')
    with pytest.raises(InvalidInputError, match="its meta files are inconsistent"):
        made("openpi", data=(good,))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InvalidInputError, match="cannot be read"):
        made("lerobot", data=(str(tmp_path / "empty"),))


@pytest.mark.parametrize(
    ("framework", "form", "options", "said"),
    [
        ("openpi", "better", {"gpus": 3}, "a batch of 128 is not divisible by 3.*Give 1, 2, 4, 8"),
        ("openpi", "better", {"gpus": 0}, "--gpus: 0 is out of range"),
        ("openpi", "better", {"data": ()}, "--data: is missing"),
        ("openpi", "better", {"data": ("a", "b")}, "2 are given, but this trainer reads one"),
        ("gr00t", {"proprioception": False}, {}, "GR00T cannot leave the state out"),
        ("being-h", {"proprioception": False}, {}, "Being-H cannot leave the state out"),
        ("being-h", {"frozen": {"being-h": ["language"]}}, {}, "freeze_llm freezes the action expert"),
        ("being-h", "better", {"data": ("a/x", "b/x")}, "folders of the same name"),
        ("lerobot", {"frozen": {"lerobot": ["vision"]}}, {"policy": "act"}, "act has no switch"),
        ("lerobot", {"steps": 30_000, "save_every": 7_000}, {}, "not a multiple of 7000"),
        ("lerobot", {"steps": 0}, {}, "steps"),
        ("lerobot", {"stepps": 1}, {}, "stepps"),
        ("lerobot", {"frozen": {"openpi": ["vision", "vision"]}}, {}, "names a part twice"),
        ("lerobot", {"name": "a b"}, {}, "name"),
        ("lerobot", {"chunk": 10}, {"policy": "diffusion"}, "chunk: .*10 is not a multiple of 8.*Give a multiple of 8"),
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
    assert "it contains another" in capsys.readouterr().err.replace("\n", " ")
