"""What a run is: its plan, its manifest, and the machine that carries it out."""
