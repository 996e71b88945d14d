"""CALVIN ABC→D as a world. A trial is a chain of five instructions.

- ``world``: plans of runs, the command of the simulator process, and the scene of a chain.
- ``simulator``: code of the simulator process, which runs in an environment without betterbench.
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
