"""Prompts, which are stored as data and chosen by an identifier (see :data:`PROMPTS`)."""

from betterbench.vlm.prompts.prompt import PROMPTS, Prompt, find_prompt, prompts_of

__all__ = ["PROMPTS", "Prompt", "find_prompt", "prompts_of"]
