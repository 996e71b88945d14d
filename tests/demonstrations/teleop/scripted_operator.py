"""An operator who packs fruit through a session: who knows where things are, and asks for poses as a person would."""

from __future__ import annotations

from betterbench.demonstrations.teleop.session import Command, TeleopSession
from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.tasks import get_task

TASK, CONDITION, SEED = "fruit_lunch", "train1", 500_000_000
ITEMS = ("apple", "orange")
SPOTS_M = ((0.068, 0.086), (0.084, 0.0))
"""Where the first and the second item go, in the frame of the lunchbox [m]: about where demonstrations let go."""
LIFT_M, DROP_M = 0.22, 0.213
"""How far above its grasp an item is carried, and how far it is let down over its spot [m]."""


def fresh_scene(task: str = TASK, condition: str = CONDITION, seed: int = SEED) -> Scene:
    found = get_task(task)
    return Scene(found, found.train(condition), seed=seed, action_space=EE_DELTA)


def go(session: TeleopSession, target: Pose, *, closed: bool, most: int = 100) -> None:
    for _ in range(most):
        session.step(Command(target, closed))
        if session.phase != "going" or session.is_waiting(target):
            return


def hold(session: TeleopSession, steps: int, *, closed: bool) -> None:
    for _ in range(steps):
        session.step(Command(None, closed))


def grasp_of(session: TeleopSession, kind: str) -> tuple[Pose, Pose]:
    """Return where the gripper takes the first object of a kind, and how it holds it above the target."""
    state = session.state
    name = next(o.name for o in state.info.objects if o.kind == kind)
    asset = next(p.asset for p in session.scene.placements if p.spec.name == name)
    place = state.pose(name) @ asset.grasps[0].pose
    return Pose(place.position, session.state.commanded_pose.quaternion), state.pose(name)


def above_spot(session: TeleopSession, number: int, grasp: Pose) -> Pose:
    """Return where the tool carries an item before it is let down to the first (0) or second (1) spot."""
    x, y, _ = session.state.pose("lunchbox").apply((*SPOTS_M[number], 0.0))
    return Pose((x, y, grasp.position[2] + LIFT_M), grasp.quaternion)


def pack(session: TeleopSession, kind: str, number: int) -> None:
    """Take an object from above, and let go of it in the lunchbox."""
    grasp, _ = grasp_of(session, kind)
    go(session, grasp.translated(z=0.12), closed=False)
    go(session, grasp, closed=False)
    hold(session, 10, closed=True)
    go(session, grasp.translated(z=LIFT_M), closed=True)
    above = above_spot(session, number, grasp)
    go(session, above, closed=True)
    go(session, above.translated(z=-DROP_M), closed=True)
    hold(session, 10, closed=False)
    go(session, above, closed=False)
    hold(session, 20, closed=False)
