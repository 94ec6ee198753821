"""The vocabulary that every stage shares: axes, columns, recordings, machining, errors. No logic."""
