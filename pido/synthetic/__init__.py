"""A machine whose truth is known: its own dynamics, integrated in time, apart from all that looks for them."""
