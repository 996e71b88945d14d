"""Workers and policy replicas that run as actors on a Ray cluster.

Only ``session`` and the modules that use it import Ray.
"""
