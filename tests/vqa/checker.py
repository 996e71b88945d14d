# ruff: noqa: ARG002, ARG004 - the methods of all families are called alike
"""Derives the answers of a set again from the records, with nothing of the code that made them.

Poses, contacts, held objects and recorded predicates come from the columns of the record; pixels come from MuJoCo's own
renderer. What a family of questions means is written here once more.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import mujoco
import numpy as np

from betterbench.records import RunFolder

GROUPS = {
    "plates": {"dinner_plate", "place_plate", "serving_plate"},
    "mugs": {"mug"},
    "spice jars": {"spice_jar", "plain_salt_jar", "plain_pepper_jar", "plain_paprika_jar"},
    "pieces of fruit": {"apple", "orange", "lemon"},
    "pieces of cutlery": {"fork", "spoon"},
    "drawers": {"upper_drawer", "lower_drawer"},
}


def rotation(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turned_about(vector):
    """The rotation of an axis-angle vector, by the formula of Rodrigues."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)


class Frame:
    """One row of one record, and what one camera shows of it."""

    def __init__(self, record, row, masks, camera):
        self.record, self.row, self.masks, self.camera = record, row, masks, camera
        self.objects = record.metadata.scene.objects
        self.named = {o.name: i for i, o in enumerate(self.objects)}

    def of_kind(self, kind):
        return [i for i, o in enumerate(self.objects) if o.kind == kind]

    def one(self, kind):
        (i,) = self.of_kind(kind)
        return i

    def center(self, i):
        height = self.objects[i].size_m[2]
        turn = rotation(self.record.object_quaternions[self.row, i])
        return self.record.object_positions[self.row, i] + turn @ np.array([0, 0, 0.5 * height])

    def true(self, label):
        names = self.record.metadata.predicate_names
        return bool(self.record.predicates[self.row, names.index(label)]) if label in names else None

    def at(self, relation, name, target):
        """The region at which something is by the recorded predicates, "" for the only one, None for none."""
        found = None
        for label in self.record.metadata.predicate_names:
            match = re.fullmatch(rf"{relation}\({re.escape(name)}, {re.escape(target)}(?:\.(\w+))?\)", label)
            if match:
                found = found or ("no", None)
                if self.true(label):
                    found = ("yes", match[1] or "")
        return found

    def held(self):
        i = int(self.record.held[self.row])
        return None if i < 0 else i

    def touching(self):
        c, b = self.record.contacts, self.record.bodies
        pairs = c.bodies[c.offsets[self.row] : c.offsets[self.row + 1]]
        return {frozenset((b[x], b[y])) for x, y in pairs}

    def column(self, i):
        return float(np.nonzero(self.masks == i)[1].mean())

    def pixels(self, i):
        return int((self.masks == i).sum())


class Scenes:
    """Draws masks of recorded states with MuJoCo's own renderer."""

    def __init__(self, run, size):
        self.run, self.size, self.hash, self.renderer = run, size, None, None

    def close(self):
        """Frees the buffers while their OpenGL context is current: otherwise those of the next renderer go too."""
        if self.renderer is not None:
            self.renderer._gl_context.make_current()
            self.renderer._mjr_context.free()
            self.renderer._mjr_context = None
            self.renderer.close()

    def frame(self, record, row, camera):
        m = record.metadata
        if m.scene_hash != self.hash:
            files = self.run.load_scene(m.scene_hash)
            self.model = mujoco.MjModel.from_binary_path("s.mjb", {"s.mjb": files["model.mjb"]})
            self.model.vis.quality.offsamples = 0
            self.model.vis.global_.offwidth = self.model.vis.global_.offheight = self.size
            self.close()
            self.data, self.hash = mujoco.MjData(self.model), m.scene_hash
            self.renderer = mujoco.Renderer(self.model, self.size, self.size)
            self.renderer.enable_segmentation_rendering()
        number = self.model.camera(camera).id
        self.data.qpos[:] = record.qpos[row]
        mujoco.mj_forward(self.model, self.data)
        jitter, body = m.view_jitter.cameras.get(camera), self.model.cam_bodyid[number]
        axes, position = rotation(self.model.cam_quat[number]), self.model.cam_pos[number].copy()
        if jitter is not None:
            position += axes @ np.asarray(jitter.shift_m)
            axes = axes @ turned_about(jitter.turn_rad)
        carried = self.data.xmat[body].reshape(3, 3)  # MuJoCo places cameras of bodies that never move only once
        self.data.cam_xpos[number] = self.data.xpos[body] + carried @ position
        self.data.cam_xmat[number] = (carried @ axes).ravel()
        option = mujoco.MjvOption()
        option.sitegroup[:] = 0
        self.renderer.update_scene(self.data, camera, option)
        self.renderer.scene.flags[:] = 0  # neither sky nor haze, which are colors and no numbers
        self.renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        shown = self.renderer.render()
        body = np.where(
            shown[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM), self.model.geom_bodyid[np.maximum(shown[..., 0], 0)], -1
        )
        masks = np.full(body.shape, -1)
        for i, o in enumerate(m.scene.objects):
            masks[body == self.model.body(f"object{i}_{o.category}").id] = i
        R, p = self.data.cam_xmat[number].reshape(3, 3).copy(), self.data.cam_xpos[number].copy()
        return Frame(record, row, masks, (R, p))


def numbers(text):
    return [int(v) for v in re.findall(r"-?\d+", text)]


def box_of(frame, i):
    rows, columns = np.nonzero(frame.masks == i)
    return [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]


def near(a, b):
    return all(abs(x - y) <= 1 for x, y in zip(a, b, strict=True))


def yes(value):
    return None if value is None else "Yes" if value else "No"


class Checker:
    """Derives answers; None for what cannot be derived from what was recorded."""

    def __init__(self, run: RunFolder, size: int) -> None:
        self.run, self.scenes, self.records = run, Scenes(run, size), {}

    def wrong(self, question):
        """A sentence if the answer is wrong, "" if it is right, None if nothing can be said."""
        s = question["source"]
        key = (s["task"], s["condition"], s["seed"])
        if key not in self.records:
            self.records = {key: self.run.read_record(*key)}
        frame = self.scenes.frame(self.records[key], s["row"], s["camera"])
        verdict = getattr(self, "_" + re.sub(r"\W", "_", question["family"]))(frame, question, *question["group"][1:])
        if isinstance(verdict, str):
            verdict = verdict == question["answer"]
        return None if verdict is None else "" if verdict else f"{question['family']}: {question['answer']}"

    # Grounding.
    def _box_of(self, f, q, kind):
        return near(box_of(f, f.one(kind)), numbers(q["answer"]))

    def _point_at(self, f, q, kind):
        x, y = numbers(q["answer"])
        around = f.masks[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
        return bool((around == f.one(kind)).any())

    def _what_is_in_box(self, f, q, *_):
        return near(box_of(f, f.one(q["answer"])), numbers(q["words"]["box"]))

    # Counting.
    def _how_many_of_kind(self, f, q, kind):
        return str(sum(f.pixels(i) > 3 for i in f.of_kind(kind)))

    def _how_many_of_group(self, f, q, word):
        return str(sum(f.pixels(i) > 3 for i, o in enumerate(f.objects) if o.category in GROUPS[word]))

    def _how_many_inside(self, f, q, kind):
        target = f.objects[f.one(kind)].name
        found = [f.at("inside", o.name, target) for o in f.objects]
        return str(sum(x is not None and x[0] == "yes" for x in found)) if any(found) else None

    # Relations.
    def _side_in_image(self, f, q, side, a, b):
        left = f.column(f.one(a)) < f.column(f.one(b))
        return yes(left if side == "left" else not left)

    def _closer_to_camera(self, f, q, a, b):
        R, p = f.camera
        depth = {k: float(-R[:, 2] @ (f.center(f.one(k)) - p)) for k in (a, b)}
        return min(depth, key=depth.get)

    def _side_for_robot(self, f, q, side, a, b):
        left = f.center(f.one(a))[1] > f.center(f.one(b))[1]
        return yes(left if side == "left" else not left)

    def _closer_to_robot(self, f, q, a, b):
        away = {k: float(np.hypot(*f.center(f.one(k))[:2])) for k in (a, b)}
        return min(away, key=away.get)

    def _side_of_anchor(self, f, q, region, a, b):
        found = f.at("beside", f.objects[f.one(a)].name, f.objects[f.one(b)].name)
        return None if found is None else yes(found == ("yes", region))

    def _outermost(self, f, q, side, *kinds):
        columns = {k: f.column(f.one(k)) for k in kinds}
        return (min if side == "leftmost" else max)(columns, key=columns.get)

    # Containment.
    def _inside(self, f, name, where):
        relation = {"in the": "inside", "in a hole of the": "in_hole", "on the ring of the": "on_ring"}
        words = next(w for w in sorted(relation, key=len, reverse=True) if where.startswith(w + " "))
        target = f.objects[f.one(where.removeprefix(words + " "))].name
        found = f.at(relation[words], name, target)
        return None if found is None else found[0] == "yes"

    def _is_it_in(self, f, q, kind, where):
        return yes(self._inside(f, f.objects[f.one(kind)].name, where))

    def _where_is_it(self, f, q, kind, where):
        i = f.one(kind)
        inside = self._inside(f, f.objects[i].name, where)
        if inside is None:
            return None
        if inside:
            return where
        on_table = frozenset((f.objects[i].name, "table")) in f.touching()
        return "in the gripper" if f.held() == i else "on the table" if on_table else None

    def _what_is_in(self, f, q, where, *_):
        inside = [o.kind for o in f.objects if o.name and self._inside(f, o.name, where)]
        known = [o for o in f.objects if self._inside(f, o.name, where) is not None]
        return (inside[0] if len(inside) == 1 else "nothing" if not inside else None) if known else None

    # Stacking.
    def _on(self, f, base):
        """Kinds of what lies directly on a base, or None if nothing was recorded about it."""
        name = f.objects[f.one(base)].name
        layers = {o.kind: f.at("layer", o.name, name) for o in f.objects}
        if any(layers.values()):
            return [k for k, v in layers.items() if v == ("yes", "1")]
        plates = {o.kind: f.at("on_plate", o.name, name) for o in f.objects}
        if not any(plates.values()):
            return None
        on = [k for k, v in plates.items() if v is not None and v[0] == "yes"]
        return [k for k in on if frozenset((f.objects[f.one(k)].name, name)) in f.touching()]

    def _what_is_on(self, f, q, base, *_):
        on = self._on(f, base)
        return None if on is None else on[0] if on else "nothing"

    def _is_it_on(self, f, q, kind, base):
        on = self._on(f, base)
        return None if on is None else yes(kind in on)

    def _order(self, f, q, base, *kinds):
        return ", ".join(sorted(kinds, key=lambda k: float(f.center(f.one(k))[2])))

    def _higher(self, f, q, a, b):
        return max((a, b), key=lambda k: float(f.center(f.one(k))[2]))

    # State.
    def _is_it_open(self, f, q, kind):
        name = f.objects[f.one(kind)].name
        shut = [f.true(n) for n in f.record.metadata.predicate_names if n.startswith(f"closed({name},")]
        return yes(not any(shut)) if shut else None

    def _gripper_open(self, f, q):
        share = float(f.record.finger_width[f.row]) / f.record.metadata.scene.gripper_opening_m
        return "open" if share > 0.5 else "closed"

    def _what_is_held(self, f, q, *_):
        return "nothing" if f.held() is None else f.objects[f.held()].kind

    def _is_it_held(self, f, q, kind):
        return yes(f.held() == f.one(kind))

    def _fallen_over(self, f, q, kind):
        up = rotation(f.record.object_quaternions[f.row, f.one(kind)])[2, 2]
        return yes(up < math.cos(0.5))

    # Execution.
    def _what_is_it_doing(self, f, q, *_):
        if f.held() is not None:
            return q["answer"].startswith("carrying") and self._names(q["answer"], f.objects[f.held()].kind)
        later = f.record.held[f.row :]
        taken = later[later >= 0]
        return bool(len(taken)) and self._names(q["answer"], f.objects[int(taken[0])].kind)

    @staticmethod
    def _names(text, kind):
        return kind.split()[-1] in text

    def _done(self, f):
        return [bool(v) for v in f.record.subgoals[f.row]]

    def _is_step_done(self, f, q, text, step):
        names = f.record.metadata.subgoal_names
        fitting = [n for n in range(len(names)) if self._step_fits(f, names[n], step, names)]
        return yes(self._done(f)[fitting[0]]) if len(fitting) == 1 else None

    @staticmethod
    def _step_fits(f, name, step, names):
        """Whether the name of a subgoal ("pack_burger_2", "load_stapler", "salt_hole_1") speaks of a step's words."""
        second = "second" in step
        if second != name.endswith("_2") and not re.search(r"hole_\d|layer_\d", name):
            return False
        if step.startswith("close"):
            return name.startswith("close") and name.split("_")[-1] in step
        if name.startswith("close"):
            return False
        layer = re.match(r"layer_(\d)_", name)
        if layer:
            return f"layer {layer[1]}" in step
        drop = {"pack", "load", "place", "throw", "on", "2", "hole", "1", "3", "mug" if len(names) == 1 else ""}
        words = [w for w in name.split("_") if w not in drop]
        return all(w in step for w in words) or (len(names) == 1)

    def _what_is_done(self, f, q, text):
        done = self._done(f)
        if all(done):
            return "all of it"
        if not any(done):
            return "nothing yet"
        parts = q["answer"].removeprefix("only: ").split("; ")
        names = f.record.metadata.subgoal_names
        said = [n for n in range(len(names)) if any(self._step_fits(f, names[n], p, names) for p in parts)]
        return said == [n for n in range(len(names)) if done[n]] and q["answer"].startswith("only: ")

    def _what_is_next(self, f, q, text):
        done = self._done(f)
        if all(done):
            return "nothing, all of it is done"
        names = f.record.metadata.subgoal_names
        return self._step_fits(f, names[done.index(False)], q["answer"], names)

    # Premise.
    def _is_it_there(self, f, q, kind):
        return yes(bool(f.of_kind(kind)))

    def _is_it_a(self, f, q, kind, *_):
        box = numbers(q["words"]["box"])
        inside = [i for i in range(len(f.objects)) if f.pixels(i) and near(box_of(f, i), box)]
        return yes(any(f.objects[i].kind == kind for i in inside)) if inside else None

    def _can_it_be_done(self, f, q, text):
        words = [w for o in f.objects for w in o.kind.split()]
        missing = [w for w in ("apple", "orange", "lemon", "burger", "fries", "drink") if w in text and w not in words]
        return yes(not missing)


def check(run: RunFolder, folder: Path, most: int | None = None):
    """Returns wrong answers, the number of answers that were derived, and families with answers that could not be."""
    lines = [json.loads(line)["betterbench"] for line in (folder / "questions.jsonl").read_text().splitlines()][:most]
    order = sorted(lines, key=lambda q: (q["source"]["task"], q["source"]["condition"], q["source"]["seed"]))
    checker, wrong, derived, open_ = Checker(run, lines[0]["width"]), [], 0, {}
    for question in order:
        verdict = checker.wrong(question)
        if verdict is None:
            open_[question["family"]] = open_.get(question["family"], 0) + 1
        else:
            derived += 1
        if verdict:
            wrong.append((question["id"], verdict, question["text"], question["source"]))
    checker.scenes.close()
    return wrong, derived, open_
