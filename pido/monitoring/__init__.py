"""The residual of a part, watched against a band that a model and earlier good parts justify.

This is quality information, not a safety stop: it must never be the only thing between a machine and a person.
"""
