"""``better real run``: guide an operator through the trials of a protocol."""

from __future__ import annotations

import dataclasses
import os
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from betterbench.cli.console import OUT, say
from betterbench.cli.person import person_named
from betterbench.errors import InvalidInputError, require_between

if TYPE_CHECKING:
    from betterbench.real.limits import SafetyLimits
    from betterbench.real.plan import RealPlan
    from betterbench.real.robots.robot import Robot
    from betterbench.real.session import RealSession

LAST_LOOK_S = 1.0
"""Time for which the browser page stays open after all trials are finished [s]."""
_KEYS = "a: switch on or off   s: start   f: start anyway   e: over   space: STOP   u: undo   r: discard   q: quit"


def run_command(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    robot: Literal["so101", "mock"] = "so101",
    arm_port: str = "",
    arm_id: str = "follower",
    cameras: tuple[str, ...] = ("front=0",),
    camera_size: tuple[int, int] = (640, 480),
    camera_rate_hz: int = 30,
    limits: Path | None = None,
    repeat: tuple[str, ...] = (),
    mock_faults: tuple[str, ...] = (),
    author: str | None = None,
    page: bool = True,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> None:
    """Guide an operator through the trials of a plan: set up the scene, start the policy, enter the outcome.

    The page shows the planned position of each object as an overlay on the image of the front camera, and checks
    whether the scene matches. The arm moves only while it is switched on, and only within the safety limits; the space
    key stops it. Stopped and interrupted trials are repeated. Running the command again continues where it stopped.
    Keys also work in the terminal. With --no-page, they work only there.

    By default, the page can only be opened on this machine. To open it on another machine, forward the port (ssh -L
    8080:127.0.0.1:8080 MACHINE). The printed address contains the access token of the page.

    Example: better real run bench --arm-port /dev/ttyACM0 --cameras front=0 wrist=2

    Args:
        folder: Folder of the protocol.
        robot: so101 for an SO-101 connected through LeRobot; mock for a simulated arm to practice with.
        arm_port: Serial port of the arm.
        arm_id: Id of the arm's calibration in LeRobot.
        cameras: Cameras as NAME=INDEX or NAME=PATH, one of them named front; for the mock arm only names.
        camera_size: Width and height of the images in pixels.
        camera_rate_hz: Frame rate of the cameras.
        limits: JSON file with non-default safety limits, such as {"speed_rad_s": 1.0}.
        repeat: Codes of trials to repeat because their files are damaged, as listed by `better real report`; the
            damaged files are kept in FOLDER/aborted.
        mock_faults: Simulated faults of the mock arm as NAME=VALUE, such as stalled=elbow_flex after_s=1.
        author: Name of the operator; default: the user name.
        page: Show the page in the browser.
        host: Network interface to listen on. With 0.0.0.0, other machines can open the page, but its access token is
            sent unencrypted.
        port: Port to listen on; 0 for any free port.
    """
    from betterbench.cli.verbs.serve import stopped_by_signal
    from betterbench.real.page import OperatorPage
    from betterbench.real.plan import read_plan
    from betterbench.real.record import repeat_damaged
    from betterbench.real.session import RealSession

    for side in camera_size:
        require_between("--camera-size", side, 16, 4096)
    person = person_named(author, "--author")
    plan = read_plan(folder)
    if robot == "mock":
        arm = _mock(plan, cameras, camera_size, mock_faults)
    else:
        if mock_faults:
            raise InvalidInputError(
                "--mock-faults", "they apply only to the mock arm", "Leave out --mock-faults, or use --robot mock"
            )
        arm = _so101(plan, arm_port, arm_id, cameras, size=camera_size, rate_hz=camera_rate_hz)
    if repeat:
        repeat_damaged(folder, repeat, person)
    size = (320, round(320 * camera_size[1] / camera_size[0]))
    with (
        RealSession(folder, arm, person=person, limits=_limits(limits), size=size, say=_tell) as session,
        stopped_by_signal() as stopped,
    ):
        served = OperatorPage(session, host=host, port=port) if page else None
        try:
            if served is not None:
                if not served.server.is_local:
                    say(f"On {host}, the page's token is sent unencrypted. Use SSH port forwarding instead.")
                OUT.print(f"open {served.server.url}", markup=False, soft_wrap=True)
            with _terminal_keys(session, stopped, needed=not page):
                session.run(stopped)
            if served is not None and not stopped.is_set():
                stopped.wait(LAST_LOOK_S)
        finally:
            if served is not None:
                served.server.close()
    left = session.view.planned - session.view.done
    say(f"stopped; {left} of {session.view.planned} trials are left" if left else "every trial is done", whole=True)


def _tell(text: str) -> None:
    say(text, whole=True)


def _named(texts: tuple[str, ...], option: str) -> dict[str, str]:
    """Parse strings of the form NAME=VALUE into a mapping.

    Raises:
        InvalidInputError: If a string has a different form, or a name occurs twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator or not name.isidentifier() or name in found:
            raise InvalidInputError(
                option,
                f"expected NAME=VALUE with each name given once, got {text!r}",
                "Write, for example, front=0",
            )
        found[name] = value
    return found


def _so101(
    plan: RealPlan, port: str, arm_id: str, cameras: tuple[str, ...], *, size: tuple[int, int], rate_hz: int
) -> Robot:
    from betterbench.real.robots.lerobot_arm import LeRobotArm

    named = _named(cameras, "--cameras")
    if "front" not in named:
        raise InvalidInputError(
            "--cameras",
            "no camera is named front",
            "Name one camera front, such as front=0; its image is compared with the simulated twin",
        )
    return LeRobotArm(port, arm_id=arm_id, unit=plan.unit, cameras=named, size=size, rate_hz=rate_hz)


def _mock(plan: RealPlan, cameras: tuple[str, ...], size: tuple[int, int], faults: tuple[str, ...]) -> Robot:
    from pydantic import TypeAdapter

    from betterbench.json_form import parse_json, read_form
    from betterbench.real.robots.mock import MockFaults, MockRobot

    form: dict[str, Any] = {}
    texts = {field.name for field in dataclasses.fields(MockFaults) if field.type == "str"}
    for name, value in _named(faults, "--mock-faults").items():
        form[name] = value
        if name not in texts:
            try:
                form[name] = parse_json(value)
            except ValueError:
                raise InvalidInputError(
                    "--mock-faults", f"{value!r} is not a valid value for {name}", "Use a number"
                ) from None
    made = read_form(TypeAdapter(MockFaults), form, where="--mock-faults", cure="Use a different value")
    names = tuple(text.partition("=")[0] for text in cameras)
    return MockRobot(plan, faults=made, cameras=names, size=size)


def _limits(path: Path | None) -> SafetyLimits | None:
    """Read the safety limits from a file. Return None if no file is given."""
    from pydantic import TypeAdapter

    from betterbench.json_form import read_bounded, read_form
    from betterbench.real.limits import SafetyLimits

    if path is None:
        return None
    raw = read_bounded(path, max_bytes=1 << 16, cure="Use a JSON file")
    return read_form(TypeAdapter(SafetyLimits), raw, where=str(path), cure="Use a different value")


@contextmanager
def _terminal_keys(session: RealSession, stopped: threading.Event, *, needed: bool) -> Iterator[None]:
    """Execute the keys that are pressed in the terminal while the context is open.

    If there is no terminal and ``needed`` is set, the lines of standard input are executed as keys instead.
    """
    if not sys.stdin.isatty():
        if needed:
            threading.Thread(target=_obey_lines, args=(session, stopped), daemon=True).start()
        yield
        return
    say(_KEYS, whole=True)
    handle = sys.stdin.fileno()
    before = termios.tcgetattr(handle)
    tty.setcbreak(handle)
    threading.Thread(
        target=_obey_keys, args=(session, stopped, lambda: os.read(handle, 1).decode("ascii", "replace")), daemon=True
    ).start()
    try:
        yield
    finally:
        termios.tcsetattr(handle, termios.TCSADRAIN, before)


def _obey_lines(session: RealSession, stopped: threading.Event) -> None:
    """Execute each line of standard input as a key. The key may be followed by a space and a note."""
    for line in sys.stdin:
        key, _, note = line.rstrip("\n").partition(" ")
        if line.startswith(" "):
            key, note = " ", ""
        if not obey_key(session, key, note, stopped):
            return
    stopped.set()


def _obey_keys(session: RealSession, stopped: threading.Event, read: Callable[[], str]) -> None:
    note = ""
    typing = False
    while not stopped.is_set():
        key = read()
        if not key:
            return
        if typing:
            typing = key not in ("\n", "\r")
            note = note + key if typing else note
        elif key == "n":
            typing, note = True, ""
            say("note (end with Enter):")
        else:
            if not obey_key(session, key, note, stopped):
                return
            note = ""


def obey_key(session: RealSession, key: str, note: str, stopped: threading.Event) -> bool:
    """Execute a key that was pressed in the terminal. Return False if no more keys should be read."""
    from betterbench.real.outcomes import OUTCOMES
    from betterbench.real.session import Command, Stage

    view = session.view
    outcome = next((each for each in OUTCOMES if each.key == key), None)
    names = {"s": "start", "f": "force", "e": "end", "u": "undo", "r": "again"}
    if key == "q":
        stopped.set()
        return False
    if key == " ":
        session.halt()
    elif key == "a":
        session.put(Command("disarm" if view.armed else "arm"))
    elif key == "h":
        say(_KEYS, whole=True)
        for each in OUTCOMES:
            say(f"{each.key}: {each.title}. {each.definition}", whole=True)
    elif outcome is not None and view.stage is Stage.ENTER:
        session.put(Command("enter", outcome.name, note))
    elif key in names:
        session.put(Command(names[key], note=note))
    return True
