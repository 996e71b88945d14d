"""What touches what, and which relations hold: by numbers as by robosuite's and LIBERO's own names."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from betterbench.sim.worlds.libero.relations import Relations, Touching

XML = """
<mujoco><option cone="{cone}"/><worldbody>
<geom name="table_top" type="plane" size="1 1 .1"/>
<site name="place" type="box" pos=".3 0 0" size=".1 .05 .01" euler="0 0 30"/>
<site name="place_without_under" type="box" size=".1 .1 .1"/>
<body name="box" pos="0 0 .05"><freejoint/><geom name="box_a" type="box" size=".05 .05 .05"/>
  <geom type="box" size=".01 .01 .01" pos="0 0 .04"/>
  <site name="rim" type="box" size=".05 .05 .05"/></body>
<body name="ball" pos="0 0 .129"><freejoint/><geom name="ball_a" size=".03"/></body>
<body name="far" pos=".5 .5 .05"><freejoint/><geom name="far_a" size=".03" gap=".05"/></body>
<body name="finger" pos=".5 .5 .12"><freejoint/><geom name="finger_a" size=".03"/></body>
</worldbody></mujoco>
"""
LABELS = ["table", "box", "ball", "far", "left_finger"]


class Place:
    """A box that knows LIBERO's ``under`` and ``in_box``."""

    def __init__(self, size, parent_name=None):
        self.size, self.parent_name, self.object_state_type = np.array(size), parent_name, "site"

    def under(self, position, matrix, other):
        apart = matrix @ (other - position)
        return self.size[2] - 0.005 < apart[2] < self.size[2] + 0.1 and np.all(np.abs(apart[:2]) < self.size[:2])

    def in_box(self, position, matrix, other):
        half = np.abs(matrix @ self.size)
        low = position - half
        low[2] -= 0.01
        return np.all(other > low) and np.all(other < position + half)


class Env:
    """As much of an environment of LIBERO as is read."""

    def __init__(self, cone):
        model = mujoco.MjModel.from_xml_string(XML.format(cone=cone))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 20)
        mujoco.mj_forward(model, data)
        self.model, self.data, self.asked = model, data, []
        self.sim = SimpleNamespace(model=SimpleNamespace(_model=model), data=SimpleNamespace(_data=data))
        self.obj_body_id = {name: model.body(name).id for name in ("box", "ball", "far")}
        self.models = {n: SimpleNamespaceByItself(contact_geoms=[f"{n}_a", "absent"]) for n in self.obj_body_id}
        self.object_sites_dict = {
            "place": Place((0.1, 0.05, 0.01)),
            "rim": Place((0.05, 0.05, 0.05), "box"),
            "place_without_under": SimpleNamespace(),
        }
        objects = {name: SimpleNamespace(object_state_type="object") for name in self.obj_body_id}
        other = {"place_without_under": SimpleNamespace(object_state_type="site", parent_name=None)}
        self.object_states_dict = {**self.object_sites_dict, **other, **objects}

    def get_object(self, name):
        return self.models.get(name)

    def check_contact(self, one, other):
        """robosuite's, by names."""
        for i in range(self.data.ncon):
            a, b = (self.model.geom(int(g)).name for g in self.data.contact[i].geom)
            if (a in one.contact_geoms and b in other.contact_geoms) or (
                b in one.contact_geoms and a in other.contact_geoms
            ):
                return True
        return False

    def _eval_predicate(self, relation):
        self.asked.append(relation[0])
        place = self.object_sites_dict.get(relation[-1])
        if relation[0] == "open":
            return True
        if not isinstance(place, Place):
            return self.check_contact(self.models[relation[1]], self.models["ball"])
        position = self.data.site(relation[2]).xpos.copy()
        matrix, other = self.data.site(relation[2]).xmat.reshape(3, 3), self.data.body(relation[1]).xpos
        if relation[0] == "in":
            return place.in_box(position, matrix, other)
        holder = self.models.get(place.parent_name)
        return place.under(position, matrix, other) and (
            holder is None or self.check_contact(holder, self.models[relation[1]])
        )


class SimpleNamespaceByItself(SimpleNamespace):
    """Known by which one it is, as a model of robosuite is."""

    __hash__ = object.__hash__


def touching_now(env, labels):
    touching = Touching(mujoco, env, labels)
    numbers, forces = touching.now()
    return [touching.pairs[i] for i in numbers], forces


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_touching_pairs_and_their_forces_are_those_of_the_engine(cone):
    env = Env(cone)
    env.data.efc_force[:] = np.arange(1.0, env.data.nefc + 1.0)
    pairs, forces = touching_now(env, LABELS)
    expected: dict[tuple[str, ...], float] = {}
    for i in range(env.data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(env.model, env.data, i, force)
        pair = tuple(sorted(LABELS[int(env.model.geom_bodyid[g])] for g in env.data.contact[i].geom))
        expected[pair] = expected.get(pair, 0.0) + float(force[0])
    assert list(map(tuple, pairs)) == sorted(expected)
    assert [p for p in expected if "ball" in p] == [("ball", "box")]
    assert forces.tolist() == [expected[tuple(pair)] for pair in pairs]
    assert dict(zip(map(tuple, pairs), forces > 0.0, strict=True)) == {
        ("ball", "box"): True,
        ("box", "table"): True,
        ("far", "left_finger"): False,  # near, and no push yet
        ("far", "table"): False,
    }


def test_contacts_of_arm_and_table_and_within_one_thing_are_left_out():
    env = Env("elliptic")
    assert touching_now(env, ["table", "arm", "arm", "floor", "left_finger"])[0] == [["floor", "left_finger"]]
    env.data.qpos[2::7] += 1.0
    mujoco.mj_forward(env.model, env.data)
    pairs, forces = touching_now(env, LABELS)
    assert (len(pairs), len(forces)) == (2, 2)
    env.data.qpos[2::7] = [1.0, 2.0, 3.0, 4.0]
    mujoco.mj_forward(env.model, env.data)
    pairs, forces = touching_now(env, LABELS)
    assert (pairs, forces.tolist()) == ([], [])


def test_models_touch_as_robosuite_says_by_names():
    env = Env("elliptic")
    touching = Touching(mujoco, env, LABELS)
    found = {(a, b): touching.between(env.models[a], env.models[b]) for a in env.models for b in env.models}
    assert found == {(a, b): env.check_contact(env.models[a], env.models[b]) for a in env.models for b in env.models}
    assert found["box", "ball"]
    assert not found["box", "far"]


RELATIONS = [
    *(["on", name, place] for name in ("box", "ball", "far") for place in ("place", "rim", "place_without_under")),
    *(["in", name, place] for name in ("ball", "far") for place in ("place", "rim")),
    ["on", "box", "ball"],
    ["open", "box"],
]


def test_relations_hold_where_libero_says_so_and_it_is_asked_only_where_it_alone_knows():
    env = Env("elliptic")
    relations = Relations(mujoco, env, RELATIONS, Touching(mujoco, env, LABELS))
    random, both = np.random.default_rng(0), np.zeros(len(RELATIONS), int)
    for _ in range(300):
        env.data.qpos[0:3] = random.uniform((0.1, -0.1, -0.05), (0.5, 0.1, 0.1))
        env.data.qpos[7:10] = env.data.qpos[0:3] + random.uniform((-0.06, -0.06, -0.02), (0.06, 0.06, 0.09))
        mujoco.mj_forward(env.model, env.data)
        env.asked.clear()
        ours = relations.hold()
        assert env.asked == ["on", "on", "on", "on", "open"]
        assert ours.tolist() == relations.hold_by_libero().tolist()
        both += ours
    assert "check_contact" not in vars(env)
    varied = [
        i for i, r in enumerate(RELATIONS) if r[-1] in ("place", "rim") and r[1] != "far" and r != ["on", "box", "rim"]
    ]
    assert all(0 < both[i] < 300 for i in varied), both


def test_libero_is_asked_where_less_than_a_nanometer_decides():
    env = Env("elliptic")
    relations = Relations(mujoco, env, [["in", "ball", "place"]], Touching(mujoco, env, LABELS))
    env.data.qpos[7:10] = (0.3, 0.0, 0.01)
    mujoco.mj_forward(env.model, env.data)
    assert relations.hold().tolist() == relations.hold_by_libero().tolist() == [False]
    assert env.asked == ["in", "in"]
