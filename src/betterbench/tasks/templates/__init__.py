"""The constraint templates of the suite."""

from betterbench.tasks.templates.constrained_positioning import CONSTRAINED_POSITIONING
from betterbench.tasks.templates.loose_packing import LOOSE_PACKING

TEMPLATES = {t.name: t for t in (LOOSE_PACKING, CONSTRAINED_POSITIONING)}

__all__ = ["CONSTRAINED_POSITIONING", "LOOSE_PACKING", "TEMPLATES"]
