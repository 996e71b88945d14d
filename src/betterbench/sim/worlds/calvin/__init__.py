"""CALVIN ABC→D as a world: chains of five instructions.

- ``world``: its plans, its command, and the scene of a chain.
- ``simulator``: its process, which runs where betterbench is not installed.
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
