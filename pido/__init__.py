"""pido: current models of a CNC machine that stay right while parts arrive, and the physics that a simulation left out.

`import pido` is light: Prefect, MLflow and scikit-learn are imported where they are used.
"""

from pido._version import __version__

__all__ = ["__version__"]
