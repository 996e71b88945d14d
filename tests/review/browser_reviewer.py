"""A reviewer at the page of ``better review``: presses keys and buttons, drags gizmos, and types."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from betterbench.geometry import rotate

_KEY_NAMES = {
    "Enter": "Enter", "Escape": "Escape", "Backspace": "Backspace", "Delete": "Delete", "ArrowLeft": "ArrowLeft",
    "ArrowRight": "ArrowRight", "BracketLeft": "[", "BracketRight": "]",
}  # fmt: skip
_MATRICES = """(() => {
  const all = [...document.querySelectorAll('canvas')].map(c => c.getBoundingClientRect());
  const b = all.sort((a, b) => b.width * b.height - a.width * a.height)[0];
  const c = __viserMutable.camera, r = __viserMutable.nodeRefFromName['ROOT'];
  return [[b.left, b.top, b.width, b.height], c.projectionMatrix.elements, c.matrixWorldInverse.elements,
    r.matrixWorld.elements];
})()"""


ARROW_M = 0.955 * 0.06
"""Distance of the tip of an arrow of the gizmo from its origin [m]."""


def write_leaning_mug(path: Path) -> None:
    """Write a red mug with a handle that leans by 30 degrees as GLB."""
    r, h, w = 0.038, 0.09, 0.004
    body = trimesh.creation.revolve([(0, 0), (r, 0), (r, h), (r - w, h), (r - w, w), (0, w)], sections=24)
    ring = trimesh.creation.torus(0.024, 0.005, major_sections=20, minor_sections=8)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    ring.apply_translation([r + 0.016, 0, 0.047])
    ring.update_faces(ring.triangles_center[:, 0] > r - 0.003)
    mug = trimesh.util.concatenate([body, ring])
    mug.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[178, 58, 52, 255])
    )
    mug.apply_transform(trimesh.transformations.rotation_matrix(np.radians(30 - 90), [1, 0, 0]))  # glTF: y is up
    mug.export(path)


class BrowserReviewer:
    """One page in one browser."""

    def __init__(
        self,
        browser: Any,
        url: str,
        *,
        width: int = 1280,
        height: int = 800,
        dpr: float = 0.5,
        root: str = "/seen",
        gizmo: str = "/seen/frame",
    ) -> None:
        """Open the page and wait until the object or the scene is there."""
        self.browser, self._root = browser, root
        browser.call("Network.enable")
        browser.open(f"{url}/?fixedDpr={dpr}", width, height)
        self._until(f"!!(window.__viserMutable && __viserMutable.nodePoseData['{gizmo}'] && __viserMutable.camera)")
        self._until("!!window.betterPage")
        self.wait_for("judged")

    def press(self, code: str) -> None:
        """Press a key."""
        name = _KEY_NAMES.get(code, code.removeprefix("Key").removeprefix("Digit").lower())
        self.browser.key("keyDown", code, name)
        self.browser.key("keyUp", code, name)
        time.sleep(0.15)

    def text(self) -> str:
        """Return what the page says, with single spaces."""
        return " ".join(str(self.browser.value("document.body.innerText")).split())

    def click(self, label: str) -> None:
        """Click the button with a label."""
        box = self._middle(f"[...document.querySelectorAll('button')].filter(e => e.innerText.includes({label!r}))")
        self._click(*box)

    def write(self, label: str, text: str) -> None:
        """Type into the text field with a label."""
        fields = "[...document.querySelectorAll('input')].filter(e => e.type !== 'range')"
        row = (
            f"{fields}.filter(e => {{ let r = e; for (let k = 0; k < 5; k++) {{ r = r.parentElement; "
            f"if (r && r.innerText && r.innerText.trim().startsWith({label!r})) return true; }} return false; }})"
        )
        self._click(*self._middle(row))
        self.browser.call("Input.insertText", text=text)
        time.sleep(0.5)

    def _middle(self, elements: str) -> tuple[float, float]:
        box = self.browser.value(
            f"""(() => {{
              const e = ({elements}).find(e => e.getBoundingClientRect().width > 0);
              if (!e) return null;
              e.scrollIntoView({{block: 'nearest'}});
              const r = e.getBoundingClientRect();
              return [r.left + r.width / 2, r.top + r.height / 2];
            }})()"""
        )
        assert box is not None, elements
        return tuple(box)

    def _click(self, x: float, y: float) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.browser.mouse(kind, x, y)
        time.sleep(0.2)

    def gizmo(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return position (3,) [m] and quaternion (4,) of a gizmo in the object frame."""
        found = self.browser.value(f"__viserMutable.nodePoseData[{name!r}]")
        return np.array(found["position"]), np.array(found["wxyz"])

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return where points (n, 3) of the object frame [m] are on the page, (n, 2) [px]."""
        (left, top, width, height), *matrices = self.browser.value(_MATRICES.replace("ROOT", self._root))
        projection, view, root = (np.array(m).reshape(4, 4).T for m in matrices)
        x, y, _, w = projection @ view @ root @ np.vstack([points.T, np.ones(len(points))])
        return np.stack([left + 0.5 * width * (1.0 + x / w), top + 0.5 * height * (1.0 - y / w)], axis=1)

    def drag(self, begin: np.ndarray, by: np.ndarray, *, moves: int = 4) -> None:
        """Drag with the mouse from a point of the object frame along a vector [m]."""
        path = self.pixels(begin + np.linspace(0.0, 1.0, moves + 1)[:, None] * by).tolist()
        self.browser.mouse("mouseMoved", *path[0])
        time.sleep(0.3)
        self.browser.mouse("mousePressed", *path[0])
        for at in path[1:]:
            self.browser.mouse("mouseMoved", *at)
            time.sleep(0.05)
        self.browser.mouse("mouseReleased", *path[-1])
        time.sleep(0.4)

    def right_the_mug(self) -> None:
        """Turn the mug of :func:`write_leaning_mug` upright with the keys, and keep it."""
        self.wait_for("kind mug")
        for _ in range(6):
            self.press("KeyJ")
        self.wait_for("turned — Enter keeps it")
        self.press("Enter")
        self.wait_for("Kept: turned")

    def raise_grasp(self, by_m: float) -> np.ndarray:
        """Drag the first grasp back along its approach, and return the approach (3,) in the object frame."""
        self.press("Digit3")
        self.wait_for("Gizmo: grasp")
        at, quaternion = self.gizmo("/seen/frame")
        approach = np.array(rotate(tuple(quaternion), (0.0, 0.0, 1.0)))
        self.drag(at + ARROW_M * approach, -by_m * approach)
        self.wait_for("moved — Enter keeps it")
        return approach

    def wait_for(self, *texts: str, timeout_s: float = 300.0) -> str:
        """Wait until the page says one of some texts, and return all that it says."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            said = self.text()
            if any(text in said for text in texts):
                return said
            time.sleep(0.2)
        raise TimeoutError(f"the page does not say {texts}, but:\n{self.text()}")

    def _until(self, expression: str, *, timeout_s: float = 300.0) -> None:
        until = time.monotonic() + timeout_s
        while not self.browser.value(expression):
            if time.monotonic() > until:
                raise TimeoutError(expression)
            time.sleep(0.2)
