"""A headless Chromium, driven over a pipe by its own debugging protocol: no package and no port is needed."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

COMMAND = next((c for c in ("chromium", "chromium-browser", "google-chrome") if shutil.which(c)), None)
TIMEOUT_S = 60.0


class Browser:
    """One page of one browser."""

    def __init__(self, profile: Path, options: tuple[str, ...] = ("--disable-gpu",)) -> None:
        to_child, self._out = os.pipe()
        self._in, from_child = os.pipe()
        # The browser reads commands from descriptor 3 and answers on 4; ours must be out of the way first.
        read, write = (fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_child, from_child))

        def wire() -> None:
            os.dup2(read, 3)
            os.dup2(write, 4)

        self._process = subprocess.Popen(
            [
                str(COMMAND),
                "--headless=new",
                "--no-sandbox",
                *options,
                "--hide-scrollbars",
                "--remote-debugging-pipe",
                f"--user-data-dir={profile}",
                "about:blank",
            ],
            preexec_fn=wire,  # noqa: PLW1509 - a test of one thread
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for fd in (to_child, from_child, read, write):
            os.close(fd)
        os.set_blocking(self._in, False)
        self._number, self._rest, self._session = 0, b"", None
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for fd in (self._in, self._out):
            os.close(fd)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer; events that come in between are kept."""
        self._number += 1
        form: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session and not method.startswith("Target."):
            form["sessionId"] = self._session
        os.write(self._out, json.dumps(form).encode() + b"\0")
        until = time.monotonic() + TIMEOUT_S
        while time.monotonic() < until:
            answer = self._next()
            if answer is None:
                time.sleep(0.005)
            elif answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            else:
                self.events.append(answer)
        raise TimeoutError(method)

    def _next(self) -> dict[str, Any] | None:
        while b"\0" not in self._rest:
            try:
                data = os.read(self._in, 1 << 20)
            except BlockingIOError:
                return None
            if not data:
                raise RuntimeError("the browser has ended")
            self._rest += data
        first, _, self._rest = self._rest.partition(b"\0")
        return json.loads(first)

    def open(self, page: Path | str, width: int, height: int, *, scheme: str = "light") -> None:
        """Show a page, a file or an address, at a size [px] in a color scheme, and wait until it is loaded."""
        self.events.clear()
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        self.call("Page.navigate", url="about:blank")
        wanted = page if isinstance(page, str) else page.resolve().as_uri()
        self.call("Page.navigate", url=wanted)
        until = time.monotonic() + TIMEOUT_S
        while time.monotonic() < until:
            if self.value("location.href.split('#')[0] + document.readyState") == wanted + "complete":
                return
            time.sleep(0.02)
        raise TimeoutError(str(page))

    def value(self, expression: str) -> Any:
        """Return what an expression evaluates to in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", "the script failed"))
        return answer["result"].get("value")

    def wait_until(self, expression: str, *, patience_s: float = 30.0) -> None:
        """Wait until an expression holds in the page; AssertionError if it does not in time."""
        end = time.monotonic() + patience_s
        while not self.value(expression):
            assert time.monotonic() < end, f"{expression} did not come true"
            time.sleep(0.05)

    def complaints(self) -> list[str]:
        """Return what the browser complained about since the page was opened: errors, refused resources."""
        self.value("1")
        return [
            json.dumps(e["params"])[:300]
            for e in self.events
            if e.get("method") == "Runtime.exceptionThrown"
            or (e.get("method") == "Log.entryAdded" and e["params"]["entry"]["level"] in ("error", "warning"))
        ]

    def screenshot(self) -> bytes:
        """Return what the page shows as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Move, press or release the left button of the mouse ("mouseMoved", "mousePressed", "mouseReleased")."""
        held = {"button": "left", "buttons": 0 if kind == "mouseReleased" else 1, "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **held)

    def key(self, kind: str, code: str, key: str) -> None:
        """Press or release a key ("keyDown", "keyUp")."""
        self.call("Input.dispatchKeyEvent", type=kind, code=code, key=key)

    def pdf(self) -> bytes:
        """Return the page as it prints."""
        return base64.b64decode(self.call("Page.printToPDF", preferCSSPageSize=True)["data"])


@contextlib.contextmanager
def browser(profile: Path, options: tuple[str, ...] = ("--disable-gpu",)) -> Iterator[Browser]:
    made = Browser(profile, options)
    try:
        yield made
    finally:
        made.close()
