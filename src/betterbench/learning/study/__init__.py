"""Studies: training, evaluation, diagnosis and comparison of learners on every arm, from a plan to a results page."""
