"""Physical equations for the four currents: one for all samples, one per bin of the reduced space (paper, III-E)."""
