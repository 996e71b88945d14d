"""LIBERO itself, where `better worlds install libero` has been run."""

import subprocess
from collections import Counter

import numpy as np
import pytest
from tests.sim.worlds.clients import CLIENTS, differences

from betterbench.episodes import Observer
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.in_libero import in_libero
from betterbench.policies.conventions.presets import PRESETS
from betterbench.sim.worlds import ProcessScene, WorldProcess, WorldProcesses, world_named
from betterbench.sim.worlds.installation import start_code
from betterbench.sim.worlds.scene import quat2axisangle
from betterbench.tasks.worlds.libero_plus import read_variant

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not world_named("libero").is_ready, reason="better worlds install libero"),
]

STEPS = 3

CLIENT = f"""
import sys
from pathlib import Path
import numpy as np
from libero.libero import benchmark, get_libero_path
from libero.libero.envs import OffScreenRenderEnv
OBSERVED = ("agentview_image", "robot0_eye_in_hand_image", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
suite = benchmark.get_benchmark("libero_spatial")(task_order_index=0)
task = suite.get_task(5)
path = Path(get_libero_path("bddl_files")) / task.problem_folder / task.bddl_file
env = OffScreenRenderEnv(bddl_file_name=str(path), camera_heights=256, camera_widths=256)
env.seed(7)
env.reset()
obs = env.set_init_state(suite.get_task_init_states(5)[1])
for _ in range(10):
    obs, _, _, _ = env.step([0.0] * 6 + [-1.0])
for action in np.random.default_rng(0).uniform(-1.0, 1.0, ({STEPS}, 7)):
    obs, _, _, _ = env.step(action.tolist())
np.savez(
    sys.argv[1], qpos=env.sim.data.qpos, qvel=env.sim.data.qvel, **{{name: obs[name] for name in OBSERVED}},
    controller_pos=env.env.robots[0].controller.ee_pos, controller_mat=env.env.robots[0].controller.ee_ori_mat,
)
"""
"""The loop of openpi's ``examples/libero/main.py`` up to an observation."""


def test_a_request_has_the_bytes_that_the_clients_of_the_field_build(tmp_path):
    world = world_named("libero").installation
    python = world.folder / "bin" / "python"
    subprocess.run([str(python), "-c", CLIENT, str(tmp_path / "seen.npz")], check=True, capture_output=True)
    plan = make_world_plan("noop", suite="libero_spatial", tasks=["5"], trials=1, seed=1)
    processes = WorldProcesses(world.command())
    scene = ProcessScene(
        plan.world, processes, task="libero_spatial-05", condition="base", seed=1, action_space=EE_DELTA, images=True
    )
    state = scene.reset()
    assert scene.info.object("akita_black_bowl_1").role == "item"
    assert state.touching("akita_black_bowl_1", "glazed_rim_porcelain_ramekin_1")
    for i, action in enumerate(np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, 7))):
        scene.draw_next(wanted=i == STEPS - 1)  # what is not drawn changes nothing
        scene.step(action)
    seen = Observer(observation_spec("default")).observe(scene, scene.state())
    with np.load(tmp_path / "seen.npz") as obs:
        for preset, client in CLIENTS.items():
            sent, built = in_libero(PRESETS[preset]).request(seen), client(obs, scene.task.instruction)
            assert list(differences(sent, built)) == [], preset
        assert seen.native["ee_axis_angle"].tobytes() == quat2axisangle(obs["robot0_eef_quat"]).tobytes()
        assert scene.simulator_state()["qpos"].tobytes() == obs["qpos"].tobytes()
        assert scene.simulator_state()["qvel"].tobytes() == obs["qvel"].tobytes()
    scene.close(well=True)
    processes.close()


def test_a_bowl_that_slid_off_its_ramekin_breaks_the_premise():
    """The displacement that MuJoCo 3.17.0 was measured to leave, posed in an initial state."""
    code = """
from libero.libero import benchmark, get_libero_path
from libero.libero.envs import OffScreenRenderEnv
from pathlib import Path
suite = benchmark.get_benchmark("libero_spatial")(task_order_index=0)
task = suite.get_task(5)
path = Path(get_libero_path("bddl_files")) / task.problem_folder / task.bddl_file
env = OffScreenRenderEnv(bddl_file_name=str(path), camera_heights=16, camera_widths=16)
env.seed(7)
env.reset()
env.set_init_state(suite.get_task_init_states(5)[1])
relation = ["on", "akita_black_bowl_1", "glazed_rim_porcelain_ramekin_1"]
for _ in range(10):
    env.step([0.0] * 6 + [-1.0])
assert env.env._eval_predicate(relation)
joint = env.env.objects_dict["akita_black_bowl_1"].joints[0]
qpos = env.sim.data.get_joint_qpos(joint).copy()
qpos[0] += 0.062
env.sim.data.set_joint_qpos(joint, qpos)
env.sim.forward()
assert not env.env._eval_predicate(relation)
"""
    python = world_named("libero").installation.folder / "bin" / "python"
    subprocess.run([str(python), "-c", code], check=True, capture_output=True)


READ = """
import os, sys
import numpy as np
from betterbench.sim.worlds.rows import RowForm
os.environ["LIBERO_CONFIG_PATH"] = sys.prefix
simulator = LiberoSimulator()
request = {"suite": sys.argv[1], "task": int(sys.argv[2]), "state": 0, "seed": 7, "settle": 10, "images": False}
fixed, _ = simulator.start(request)
form = RowForm(fixed["row"])
mujoco, env, reader = simulator._mujoco, simulator._env, simulator._reader
model, data = env.sim.model._model, env.sim.data._data
random, seen = np.random.default_rng(0), set()
for _ in range(60):
    _, arrays = simulator.step(random.uniform(-1.0, 1.0, 7) * (1, 1, 0.3, 1, 1, 1, 1), look=False)
    assert arrays["holds"].tolist() == [bool(env._eval_predicate(p)) for p in reader._relations]
    sums = {}
    for i in range(data.ncon):
        a, b = sorted(reader._body_labels[int(model.geom_bodyid[g])] for g in data.contact[i].geom)
        if a != b and not {a, b} <= {"arm", "table", "floor"}:
            force = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, force)
            sums[a, b] = sums.get((a, b), 0.0) + float(force[0])
    for i, root in enumerate(reader._roots):
        velocity, quaternion = np.zeros(6), np.zeros(4)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, root, velocity, 0)
        mujoco.mju_mulQuat(quaternion, data.xquat[root], reader._turned[i])
        assert form.array(arrays["row"], "velocities")[i].tolist() == velocity.tolist()
        assert form.array(arrays["row"], "quaternions")[i].tolist() == quaternion.tolist()
    assert [fixed["pairs"][i] for i in arrays["touching"]] == [list(pair) for pair in sorted(sums)]
    assert arrays["forces"].tolist() == [sums[pair] for pair in sorted(sums)]
"""


@pytest.mark.parametrize(("suite", "task"), [("libero_object", 0), ("libero_goal", 8), ("libero_10", 3)])
def test_what_is_read_by_numbers_is_what_libero_and_mujoco_say(suite, task):
    world = world_named("libero").installation
    code = start_code("betterbench.sim.worlds.libero.simulator").replace(
        "import main\nmain()", "import LiberoSimulator"
    )
    command = [str(world.folder / "bin" / "python"), "-c", code + READ, suite, str(task)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.parametrize(
    "given",
    [
        {"CUDA_VISIBLE_DEVICES": "3"},
        {"CUDA_VISIBLE_DEVICES": ""},
        {"CUDA_VISIBLE_DEVICES": "GPU-5ebe9f43-ac33-420d-1628-8a0dd6a1ffc6"},
        {"CUDA_VISIBLE_DEVICES": "3", "MUJOCO_EGL_DEVICE_ID": "0"},
    ],
    ids=["number", "empty", "uuid", "with a device"],
)
def test_libero_draws_under_the_variables_of_slurm(monkeypatch, given):
    request = {"suite": "libero_object", "task": 0, "state": 0, "seed": 7, "settle": 1, "images": True, "size": 32}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    with WorldProcess(world_named("libero").start_command()) as process:
        assert process.start(request)[1]["image_front"].std() > 5.0


SCENE = """
import os, sys
import numpy as np
from pathlib import Path
os.environ["LIBERO_CONFIG_PATH"] = sys.prefix
os.environ["MUJOCO_GL"] = "egl"
simulator = LiberoPlusSimulator(Path(sys.argv[1]) / "liberoplus" / "liberoplus")
asked = {"suite": sys.argv[2], "task": 0, "variant": sys.argv[3], "state": 0, "seed": 7, "settle": 10}
fixed, arrays = simulator.start({**asked, "images": sys.argv[5] == "images", "size": 256})
env = simulator._env
camera = env.sim.model.cam_pos[env.sim.model.camera_name2id("agentview")]
drawn = {name: a for name, a in arrays.items() if name.startswith("image")}
np.savez(sys.argv[4], qpos=env.sim.data.qpos, rest=env.robots[0].controller.initial_joint, camera=camera, **drawn)
"""


@pytest.mark.skipif(not world_named("libero_plus").is_ready, reason="better worlds install libero_plus")
def test_variants_of_libero_plus_change_what_their_axis_says(tmp_path):
    world = world_named("libero_plus").installation
    code = start_code("betterbench.sim.worlds.libero_plus.simulator")
    code = code.replace("import main\nmain()", "import LiberoPlusSimulator") + SCENE
    task = "pick_up_the_alphabet_soup_and_place_it_in_the_basket"
    endings = {
        "camera": "_view_20_0_100_0_0_initstate_0",
        "robot": "_view_0_0_100_0_0_initstate_450",
        "layout": "_level1_sample1",
        "noise": "_view_0_0_100_0_0_initstate_0_noise_12",
        "language": "_language_1_view_0_0_100_0_0_initstate_0",
    }
    seen = {}
    for axis, ending in endings.items():
        out, drawn = tmp_path / f"{axis}.npz", "images" if axis in ("noise", "language") else "none"
        command = [
            world.command()[0],
            "-c",
            code,
            str(world.folder),
            "libero_plus_object",
            task + ending,
            str(out),
            drawn,
        ]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-3000:]
        with np.load(out) as arrays:
            seen[axis] = dict(arrays)
    plain = seen["language"]
    for axis, found in seen.items():
        assert (not np.array_equal(found["camera"], plain["camera"])) == (axis == "camera")
        assert (not np.array_equal(found["rest"], plain["rest"])) == (axis == "robot")
        assert (not np.array_equal(found["qpos"], plain["qpos"])) == (axis in ("robot", "layout"))
    assert np.array_equal(seen["noise"]["image_wrist"], plain["image_wrist"])
    smooth, sharp = (np.abs(np.diff(a["image_front"].astype(int), axis=0)).mean() for a in (seen["noise"], plain))
    assert smooth < 0.7 * sharp


@pytest.mark.skipif(not world_named("libero_plus").is_ready, reason="better worlds install libero_plus")
def test_most_variants_of_libero_plus_run_with_the_assets_of_libero():
    with WorldProcess(world_named("libero_plus").start_command()) as process:
        said = process.suite("libero_plus_object")
    assert len(said["tasks"]) == 2518
    ready = Counter(read_variant(task["name"]).axis for task in said["tasks"] if not task["needs"])
    assert ready == {"camera": 396, "robot": 398, "language": 354, "noise": 422, "layout": 195, "background": 62}
    words = next(
        task for task in said["tasks"] if task["name"].startswith("pick_up_the_milk") and "_lang" in task["name"]
    )
    assert words["instruction"] == words["published"] != "pick up the milk and place it in the basket"
