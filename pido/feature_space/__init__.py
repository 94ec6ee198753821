"""Where in the reduced space M = (v_x, v_y, AR) the samples of a part lie (paper, section III-D)."""
