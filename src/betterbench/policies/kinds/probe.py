"""Policy kind ``probe``: privileged policies that ignore the instruction, the images, or both."""

from betterbench.policies.experts.address import PROBE_FORM
from betterbench.policies.kinds.privileged import register_privileged

PROBE = register_privileged(PROBE_FORM, "Acts without the images or the instruction.")
