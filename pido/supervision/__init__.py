"""Monitoring in use: parts, models and answers of a workspace around the pure `pido.monitoring`.

It is quality information and no safety stop: it must never be the only thing between a machine and a person.
"""

NO_SAFETY_STOP = (
    "Quality information, not a safety stop: it never protects a person or a machine, and it may be late or wrong."
)
