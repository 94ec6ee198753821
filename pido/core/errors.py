"""Every deliberate error. The command line shows one as a message without a traceback; anything else is a bug.

A message says where, what, and what to do.
"""


class PidoError(Exception):
    """Base of all errors that a user can do something about."""


class InputError(PidoError):
    """A file or folder that a command names and that is not there, or is not what it should be."""


class RecordingError(PidoError):
    """A recording that cannot be used: unreadable, incomplete, or against physics."""


class SettingsError(PidoError):
    """Settings (machine, material, tool, stock, part.json) that are missing, unknown or impossible."""


class SettingsFileError(SettingsError):
    """A file of the plant (workspace.toml, job, machines, materials, mesh of a raw part) that is missing or faulty. No
    part is at fault for it: correct the file and ask again."""


class ProgramError(PidoError):
    """An NC program that cannot be interpreted; names line and text."""


class StoreError(PidoError):
    """A store that is damaged, locked, or asked for what it does not hold."""


class UnavailableError(StoreError):
    """A disk, database or lock that does not do its work now. What was asked for is not at fault: ask again later."""


class FitError(PidoError):
    """An equation or model that cannot be fitted on what was given."""


class DiagnosisError(PidoError):
    """Simulation and recording that cannot be compared."""


class RegistryError(PidoError):
    """A model version that does not exist, may not be promoted, or is not what its record says."""
