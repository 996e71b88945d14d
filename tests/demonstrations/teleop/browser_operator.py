"""An operator at the page of ``better teleop``: drags the arrows of the gizmo with the mouse, and presses keys."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scripted_operator import DROP_M, LIFT_M

from betterbench.demonstrations.teleop.page import GIZMO_M
from betterbench.geometry import Pose, rotate

GRAB_M = 0.955 * GIZMO_M
"""Where an arrow of the gizmo is taken, from its origin [m]: at the tip, away from the rings."""
KEYS = {"Space": " ", "KeyZ": "z", "Enter": "Enter", "KeyR": "r", "KeyF": "f", "KeyW": "w", "KeyS": "s"}
_CANVAS = """(() => {
  const all = [...document.querySelectorAll('canvas')].map(c => c.getBoundingClientRect());
  const b = all.sort((a, b) => b.width * b.height - a.width * a.height)[0];
  const c = __viserMutable.camera, r = __viserMutable.nodeRefFromName[''];
  return [[b.left, b.top, b.width, b.height], c.projectionMatrix.elements, c.matrixWorldInverse.elements,
    r.matrixWorld.elements];
})()"""


class BrowserOperator:
    """One page in one browser."""

    def __init__(self, browser: Any, url: str, *, width: int = 1280, height: int = 720) -> None:
        """Open the page and wait until the gizmo is there."""
        self.browser = browser
        browser.call("Network.enable")
        # Software draws the page of a test, and at half the resolution four times as fast.
        browser.open(f"{url}/?fixedDpr=0.5", width, height)
        self._until("!!(window.__viserMutable && __viserMutable.nodePoseData['/tool'] && __viserMutable.camera)")
        self.wait_for("ready", "paused", "waiting")

    @property
    def tool(self) -> Pose:
        """Where the gizmo is."""
        found = self.browser.value("__viserMutable.nodePoseData['/tool']")
        return Pose(tuple(found["position"]), tuple(found["wxyz"]))

    def addresses(self) -> set[str]:
        """Return what the page has asked for, without data that it made itself."""
        self.browser.value("1")
        asked = [
            e["params"]["request"]["url"] for e in self.browser.events if e["method"] == "Network.requestWillBeSent"
        ]
        opened = [e["params"]["url"] for e in self.browser.events if e["method"] == "Network.webSocketCreated"]
        return {url for url in asked + opened if not url.startswith(("data:", "blob:", "about:"))}

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return where points, (n, 3) [m], are on the page, (n, 2) [px]."""
        (left, top, width, height), *matrices = self.browser.value(_CANVAS)
        projection, view, root = (np.array(m).reshape(4, 4).T for m in matrices)
        x, y, _, w = projection @ view @ root @ np.vstack([points.T, np.ones(len(points))])
        return np.stack([left + 0.5 * width * (1.0 + x / w), top + 0.5 * height * (1.0 - y / w)], axis=1)

    def drag_to(self, wanted: Sequence[float], *, moves: int = 2) -> None:
        """Drag the arrows one after the other until the gizmo is at a position [m], and wait for the arm."""
        for axis in np.eye(3).tolist():
            tool = self.tool
            along = np.array(rotate(tool.quaternion, axis))
            length = float((np.asarray(wanted) - np.asarray(tool.position)) @ along)
            if abs(length) > 1e-3:
                self._drag(np.asarray(tool.position) + GRAB_M * along, length * along, moves)
        self.settle()

    def _drag(self, begin: np.ndarray, by: np.ndarray, moves: int) -> None:
        path = self.pixels(begin + np.linspace(0.0, 1.0, moves + 1)[:, None] * by).tolist()
        self.browser.mouse("mouseMoved", *path[0])
        time.sleep(0.2)
        self.browser.mouse("mousePressed", *path[0])
        for at in path[1:]:
            self.browser.mouse("mouseMoved", *at)
        self.browser.mouse("mouseReleased", *path[-1])
        time.sleep(0.3)

    def press(self, code: str, *, for_s: float = 0.05) -> None:
        """Press a key, and hold it for a while."""
        self.browser.key("keyDown", code, KEYS[code])
        time.sleep(for_s)
        self.browser.key("keyUp", code, KEYS[code])

    def text(self) -> str:
        """Return what the page says, with single spaces."""
        return " ".join(str(self.browser.value("document.body.innerText")).split())

    def click(self, label: str) -> None:
        """Click the button with a label."""
        box = self.browser.value(
            f"""(() => {{
              const all = [...document.querySelectorAll('button')].filter(e => e.innerText.includes({label!r}));
              const r = all.map(e => e.getBoundingClientRect()).find(r => r.width > 0 && r.height > 0);
              return [r.left + r.width / 2, r.top + r.height / 2];
            }})()"""
        )
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.browser.mouse(kind, *box)

    def wait_for(self, *texts: str, timeout_s: float = 120.0) -> str:
        """Wait until the page says one of some texts, and return all that it says."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            said = self.text()
            if any(text in said for text in texts):
                return said
            time.sleep(0.1)
        raise TimeoutError(f"the page does not say {texts}, but:\n{self.text()}")

    def settle(self) -> None:
        """Wait until time stands still: the page waits, and says nothing new for half a second."""
        before = ""
        while (said := self.wait_for("waiting")) != before:
            before = said
            time.sleep(0.5)

    def pack(self, grasp: Sequence[float], above: Sequence[float]) -> None:
        """Take an object at a place from above, and let go of it in the lunchbox."""
        x, y, z = grasp
        self.drag_to((x, y, z + 0.12))
        self.drag_to(grasp)
        self.press("Space")
        self.wait_for("Open gripper")
        self.settle()
        self.drag_to((x, y, z + LIFT_M))
        self.wait_for("waiting for you · holds")
        self.drag_to(above)
        self.drag_to((above[0], above[1], above[2] - DROP_M))
        self.press("Space")
        self.wait_for("Close gripper")
        self.wait_for("waiting", "done: save it")

    def _until(self, expression: str, *, timeout_s: float = 120.0) -> None:
        until = time.monotonic() + timeout_s
        while not self.browser.value(expression):
            if time.monotonic() > until:
                raise TimeoutError(expression)
            time.sleep(0.2)
