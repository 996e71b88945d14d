"""Workers and policy replicas as actors on a Ray cluster.

Only ``session`` and modules that use it import Ray.
"""
