"""A machine whose truth is known: its own dynamics, integrated in time; written apart from everything that looks for them."""
