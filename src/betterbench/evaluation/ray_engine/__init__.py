"""Workers and replicas of the policy as actors of a Ray cluster.

Only ``session`` and modules that use it import Ray.
"""
