"""Interface between episodes and policies: observations, actions, and the protocol that policies implement."""

from betterbench.interface.observation import CameraSpec, Observation, ObservationSpec, observation_spec
from betterbench.interface.policy import BatchPolicy, EpisodeStart, Execution, Policy, PolicyInfo, episode_number

__all__ = [
    "BatchPolicy",
    "CameraSpec",
    "EpisodeStart",
    "Execution",
    "Observation",
    "ObservationSpec",
    "Policy",
    "PolicyInfo",
    "episode_number",
    "observation_spec",
]
