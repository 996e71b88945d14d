"""CALVIN ABC→D by the book, as far as no simulator is needed: chains, starts, rules of success, and their numbers."""

from betterbench.calvin.play_table import BlockInfo, PlayTable, read_play_table
from betterbench.calvin.resampling import TRAINING_RANGE, resampled_start_of
from betterbench.calvin.results import ChainContrast, ChainResult, ChainSummary, SubtaskResult, contrast, summarize
from betterbench.calvin.rollout import STEPS_PER_SUBTASK, ChainPolicy, ChainWorld, play_chain
from betterbench.calvin.rules import done
from betterbench.calvin.sequences import CHAINS, Chain, calvin_chains, draw_chains, start_states
from betterbench.calvin.starts import ChainStart, start_of
from betterbench.calvin.subtasks import Subtask, subtask_named, subtasks

__all__ = [
    "CHAINS",
    "STEPS_PER_SUBTASK",
    "TRAINING_RANGE",
    "BlockInfo",
    "Chain",
    "ChainContrast",
    "ChainPolicy",
    "ChainResult",
    "ChainStart",
    "ChainSummary",
    "ChainWorld",
    "PlayTable",
    "Subtask",
    "SubtaskResult",
    "calvin_chains",
    "contrast",
    "done",
    "draw_chains",
    "play_chain",
    "read_play_table",
    "resampled_start_of",
    "start_of",
    "start_states",
    "subtask_named",
    "subtasks",
    "summarize",
]
