"""CALVIN ABC→D as a world, with chains of five instructions.

- ``world``: plans, command, and a chain's scene.
- ``simulator``: the process, which runs in an environment without betterbench.
"""

from betterbench.sim.worlds.calvin.world import (
    CalvinWorld,
    ChainScene,
    ChainTask,
    calvin_command,
    checkout_root,
    from_euler,
)
from betterbench.sim.worlds.registry import register_world

register_world(CalvinWorld())

__all__ = ["CalvinWorld", "ChainScene", "ChainTask", "calvin_command", "checkout_root", "from_euler"]
