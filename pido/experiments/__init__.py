"""The experiments of the paper, each one command: our figures beside the published ones."""
