"""The page on relations is carried out: its file registers a relation that judges states and gives the expert goals."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


CHECK = """
from betterbench.geometry import from_axis_angle
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.interface.state import ObjectInfo, Region
from betterbench.tasks import get_task
import dataclasses

task = get_task("desk_meeting")
state = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=FAST).reset()
info = state.info
wall, mouse = (next(o for o in info.objects if o.name == n) for n in ("laptop", "mouse"))
with_front = dataclasses.replace(wall, regions=(Region("front", (0.1, 0.0, 0.0), (0.01, 0.01, 0.01)),))
assert LEANING.regions(with_front) == ("",) and LEANING.regions(mouse) == ()
objects = tuple(with_front if o.name == "laptop" else o for o in info.objects)
i = info.index("mouse")
x, y, z = state.pose("laptop").position
near = list(state.positions)
near[i] = (x + 0.10, y, 0.02)


def judged(tilt, contacts=(("mouse", "table", 1.0), ("mouse", "laptop", 1.0)), dx=0.10):
    near[i] = (x + dx, y, 0.02)
    turned = list(state.quaternions)
    turned[i] = from_axis_angle((tilt, 0.0, 0.0))
    posed = dataclasses.replace(
        state,
        info=dataclasses.replace(info, objects=objects),
        positions=tuple(near),
        quaternions=tuple(turned),
        contacts=contacts,
    )
    return LEANING.where(posed, "mouse", "laptop"), posed


assert judged(0.3)[0] == ""
assert judged(0.1)[0] is None, "hardly tilted"
assert judged(0.3, dx=0.25)[0] is None, "too far away"
assert judged(0.3, contacts=(("mouse", "table", 1.0),))[0] is None, "does not touch the wall"
goals = LEANING.place_goals(judged(0.0)[1], "mouse", "laptop", "")
assert len(goals) == 4 and all(goal.pose.position[2] > 0.0 for goal in goals)
"""


def test_the_relation_of_the_page_works(tmp_path):
    text = (ROOT / "docs" / "adding-a-relation.md").read_text()
    file, check = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "leaning.py").write_text(file)
    code = f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\nfrom leaning import LEANING\n{check}\n{CHECK}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
