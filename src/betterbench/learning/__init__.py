"""Learning: small learners trained on demonstrations, and studies of what they learned.

- ``training``: from records to batches, the training loop, its validation and its curves (`better train`).
- ``study``: learners trained on every arm, evaluated, diagnosed and compared (`better study`).

The networks and their checkpoints are in :mod:`betterbench.policies.learned`, since a checkpoint acts as a policy.
"""
