"""Studies: learners trained on every arm, evaluated, diagnosed and compared, from one plan to one page."""
