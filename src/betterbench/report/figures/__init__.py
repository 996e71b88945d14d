"""Report figures: charts, videos, video frames and the trial player."""
