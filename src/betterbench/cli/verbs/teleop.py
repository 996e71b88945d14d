"""``better teleop``: record human demonstrations in the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, say
from betterbench.cli.person import end_process, person_named
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.demonstrations.teleop.controls import Controls
    from betterbench.demonstrations.teleop.page import Page
    from betterbench.demonstrations.teleop.store import DemonstrationStore


def teleop_command(
    *,
    out: Path,
    tasks: tuple[str, ...],
    condition: str | None = None,
    demos: int = 1,
    seed: int | None = None,
    name: str | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    cameras: tuple[str, ...] = ("front", "wrist"),
    devices: str = "auto",
    leader: str | None = None,
    leader_port: str = "",
    leader_id: str = "leader",
) -> None:
    """Demonstrate tasks in the browser and save the demonstrations into a run folder.

    The page shows the scene, the camera images, the instruction and the subgoals. The gripper follows the gizmo, keys,
    a gamepad or a SpaceMouse in the browser or on this machine, or a LeRobot leader arm. Motions can be undone up to
    the last subgoal. Only saved demonstrations are written, as ordinary records with segments and the name of the
    demonstrator. Ctrl-C keeps saved demonstrations. Running the command again resumes the job where it stopped; a
    larger --demos adds more demonstrations.

    The command needs no display. By default, the page can only be opened on this machine. To open it on another
    machine, forward the port (ssh -L 8080:127.0.0.1:8080 MACHINE). The printed address contains the access token of the
    page.

    Example: better teleop --tasks fruit_lunch --demos 3 --out runs/by_hand

    Args:
        out: Run folder.
        tasks: Tasks to demonstrate.
        condition: Training condition to demonstrate; default: all.
        demos: Demonstrations per training condition.
        seed: First seed, 1000000 or above; 500000000 if not given.
        name: Demonstrator name in the records; default: the user name.
        host: Network interface to listen on. With 0.0.0.0, other machines can open the page, but its access token is
            sent unencrypted.
        port: Port to listen on; 0 for any free port.
        cameras: Cameras whose images are shown; no images with --cameras none.
        devices: Gamepads and SpaceMice of this machine: auto, none, or a device file (/dev/input/event5).
        leader: Type of a LeRobot leader arm (so101_leader, so100_leader).
        leader_port: Serial port of the leader arm.
        leader_id: Id of the leader arm's calibration.
    """
    from betterbench.browser.server import load_viser
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.demonstrations.teleop.controls import Controls
    from betterbench.demonstrations.teleop.page import Page
    from betterbench.demonstrations.teleop.store import FIRST_TELEOPERATED_SEED, DemonstrationStore, TeleopPlan
    from betterbench.policies.serving.callers import LOOPBACK_NAMES

    load_viser()
    who, shown = person_named(name, "--name"), _cameras(cameras)
    plan = TeleopPlan(tasks, demos, condition, FIRST_TELEOPERATED_SEED if seed is None else seed)
    plan.starts()
    prepare_robots_of(tasks)
    controls = Controls()
    with ExitStack() as stack:
        stack.enter_context(_inputs(controls, devices, leader, leader_port, leader_id, task=tasks[0]))
        page = Page(controls, host=host, port=port, cameras=shown)
        stack.callback(page.close)
        store = stack.enter_context(DemonstrationStore(out, plan))
        if host not in LOOPBACK_NAMES:
            say(f"On {host}, the page's token is sent unencrypted. Use SSH port forwarding instead.")
        is_busy = _run(store, controls, page, who, shown)
    if is_busy or page.is_busy:
        end_process()


def _run(store: DemonstrationStore, controls: Controls, page: Page, who: str, cameras: tuple[str, ...]) -> bool:
    """Run the page until Ctrl-C, and return whether a thread is still running."""
    from betterbench.cli.verbs.serve import stopped_by_signal
    from betterbench.demonstrations.teleop.cameras import CameraThread
    from betterbench.demonstrations.teleop.station import Station

    with stopped_by_signal() as stopped, closing(CameraThread(cameras, page.show_image, controls.complain)) as images:
        station = Station(store, controls, page, name=who, cameras=images, loads_apart=True)
        OUT.print(f"open {page.url}", markup=False, soft_wrap=True)
        station.run(stopped)
        say(f"stopped; {store.saved} of {store.planned} demonstrations are saved in {store.run.path}")
    return station.is_busy or images.is_busy


def _cameras(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the cameras to show, without the word "none". Raise UnknownNameError if a camera does not exist."""
    from betterbench.errors import UnknownNameError

    known = ("front", "front_official", "left_shoulder", "right_shoulder", "wrist")
    shown = tuple(n for n in dict.fromkeys(names) if n != "none")
    for name in shown:
        if name not in known:
            raise UnknownNameError("camera", name, known)
    return shown


@contextmanager
def _inputs(
    controls: Controls, devices: str, leader: str | None, port: str, identity: str, *, task: str
) -> Iterator[None]:
    """Read the input devices of this machine while the context is open.

    Raises:
        InvalidInputError: If a device that was named cannot be read.
    """
    from betterbench.demonstrations.teleop.devices import Device, DeviceThread, find_devices
    from betterbench.demonstrations.teleop.leader import LeaderThread, connect_leader, motion_for
    from betterbench.sim.robots import robot
    from betterbench.tasks import get_task

    found = () if devices == "none" else find_devices()
    if devices not in ("auto", "none"):
        found = tuple(d for d in found if str(d.path) == devices) or (Device(Path(devices), devices, "gamepad"),)
    with ExitStack() as stack:
        for device in found:
            try:
                stack.callback(DeviceThread(device, controls).close)
            except InvalidInputError as problem:
                if devices != "auto":
                    raise
                say(f"not used: {problem}")
            else:
                say(f"reading the {device.kind} {device.name} ({device.path})")
        if leader is not None:
            motion = motion_for(robot(get_task(task).robot))
            stack.callback(LeaderThread(connect_leader(leader, port, identity), controls, motion).close)
            say(f"following the leader arm at {port}")
        yield
