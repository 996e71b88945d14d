"""Report figures: charts, films, film images and the trial player."""
