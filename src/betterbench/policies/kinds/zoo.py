"""Policy kind ``zoo``: faulty policies, each with one known fault. They calibrate the diagnosis."""

from betterbench.policies.experts.address import ZOO_FORM
from betterbench.policies.kinds.privileged import register_privileged

ZOO = register_privileged(ZOO_FORM, "Has one known fault.")
