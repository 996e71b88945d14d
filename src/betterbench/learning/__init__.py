"""Learning: training of small policies on demonstrations, and studies of the trained policies.

- ``training``: batches of training data, the training loop, validation and training curves (`better train`).
- ``study``: training on every arm, evaluation, diagnosis and comparison (`better study`).

The networks and their checkpoints are in :mod:`betterbench.policies.learned`, because a checkpoint is a policy.
"""
