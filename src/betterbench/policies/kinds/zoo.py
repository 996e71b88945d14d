"""The zoo: privileged policies with one fault each, which calibrate the diagnosis."""

from betterbench.policies.experts.address import ZOO_FORM
from betterbench.policies.kinds.privileged import register_privileged

ZOO = register_privileged(ZOO_FORM, "Has one known fault.")
