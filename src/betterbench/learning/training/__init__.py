"""Training of learned policies on demonstrations: from records to batches, the loop, its validation and its curves."""
