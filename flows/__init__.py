"""Prefect only: load, call pido, save, log. Nothing here decides what a result is."""
