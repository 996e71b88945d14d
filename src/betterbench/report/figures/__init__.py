"""Figures of a report: charts, videos, video frames and the trial player."""
