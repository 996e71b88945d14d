"""What a run is: its plan, the manifest written when it starts, and how the plan of another run is repeated."""
