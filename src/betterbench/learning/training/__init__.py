"""Training of learned policies on demonstrations: data, batches, the loop, validation and curves."""
