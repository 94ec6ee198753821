"""The four axes, in the order in which every array with one column per axis holds them."""

AXES = ("x", "y", "z", "sp")
LINEAR_AXES = ("x", "y", "z")
