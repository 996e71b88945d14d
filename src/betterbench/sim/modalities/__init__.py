"""Materialization: images, depth, masks, boxes and flow of every recorded state, while recording or later."""
