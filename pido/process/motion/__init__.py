"""2b: toolpath -> motion of the axes over time; and the machine's settings for that, from a recording."""

from pido.process.motion.dynamics import Dynamics, check_machine
from pido.process.motion.fit import FollowedPath, block_times, fit_dynamics, follow
from pido.process.motion.plan import Motion, plan_motion

__all__ = [
    "Dynamics", "FollowedPath", "Motion", "block_times", "check_machine", "fit_dynamics", "follow", "plan_motion",
]  # fmt: skip
