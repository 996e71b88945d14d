"""Materialized modalities on disk: images, masks and boxes of recorded states, readable without a simulator."""
