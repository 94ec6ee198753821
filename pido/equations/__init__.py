"""Physical equations for the four currents: one for all samples, and one per bin of the reduced space (paper, III-E)."""
