"""Which samples are generated, how many and where, and which are refused (paper, III-F)."""
