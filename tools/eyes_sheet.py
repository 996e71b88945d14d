"""Draw the picture of ``docs/vlm.md``: a scene of the suite at each resolution of ``better vlm --eyes``.

MUJOCO_GL=egl python tools/eyes_sheet.py docs/pictures/eyes.jpg
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

from PIL import Image

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task
from betterbench.vlm.models.eyes import contact_sheet

TASK, SEED = "seasoning_rack", 0


def main() -> None:
    """Render the scene and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    out: Path = parser.parse_args().out
    task = get_task(TASK)
    quality = quality_preset("high")
    scene = Scene(task, task.training[0], seed=SEED, action_space=EE_DELTA, quality=quality)
    with Renderer(scene.model, width=640, height=480, quality=quality) as renderer:
        rgb = renderer.render(scene.data, "front").rgb
    if rgb is None:
        raise AssertionError("colors were requested")
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "PNG")
    with Image.open(io.BytesIO(contact_sheet(file.getvalue(), side=300))) as sheet:
        sheet.save(out, quality=85)


if __name__ == "__main__":
    main()
