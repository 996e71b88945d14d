"""Workers and policy replicas on a Ray cluster."""
