"""Parts of CALVIN ABC→D that need no simulator: chains of subtasks, start states, success rules and results."""

from betterbench.tasks.worlds.calvin.play_table import BlockInfo, PlayTable, read_play_table
from betterbench.tasks.worlds.calvin.resampling import TRAINING_RANGE, resampled_start_of
from betterbench.tasks.worlds.calvin.results import (
    ChainContrast,
    ChainResult,
    ChainSummary,
    SubtaskResult,
    contrast,
    summarize,
)
from betterbench.tasks.worlds.calvin.rollout import STEPS_PER_SUBTASK, ChainPolicy, ChainWorld, play_chain
from betterbench.tasks.worlds.calvin.rules import done
from betterbench.tasks.worlds.calvin.sequences import CHAINS, Chain, calvin_chains, draw_chains, start_states
from betterbench.tasks.worlds.calvin.starts import ChainStart, start_of
from betterbench.tasks.worlds.calvin.subtasks import Subtask, subtask_named, subtasks
from betterbench.tasks.worlds.calvin.suites import CHAIN_SUITES

__all__ = [
    "CHAINS",
    "CHAIN_SUITES",
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
