"""Policy kind ``expert``: a policy that follows the instruction by planning with the simulator state."""

from betterbench.policies.experts.address import EXPERT_FORM
from betterbench.policies.kinds.privileged import register_privileged

EXPERT = register_privileged(EXPERT_FORM, "Follows the instruction in order.")
